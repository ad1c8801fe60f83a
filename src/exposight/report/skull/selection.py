"""What of the skull's result a figure shows: a capture, a crop, a value a feature, fewer points.

Nothing here is computed that the result does not hold; it is only picked out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.demo import NOMINAL_EXPOSURE_MS
from exposight.observing import Visibility

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import Capture
    from exposight.demo import SkullResult
    from exposight.observing import FeatureView


_MARGIN_PX = 30
_MARGIN_MM = 15.0
_STRAY_SHARE = 0.005
"""Share of points on each side that may lie outside what is shown: strays on the background."""


@dataclass(frozen=True, kw_only=True)
class Crop:
    """A rectangle of the image, its ends excluded, px."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def width(self) -> int:
        """Columns."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Rows."""
        return self.bottom - self.top

    def of(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Cut the rectangle out of a (rows, columns, …) image."""
        return image[self.top : self.bottom, self.left : self.right]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """Every n-th row and column of an organised cloud, inside a crop, without strays in depth.

    Parameters
    ----------
    step : int
        n.
    rows, columns : (n,) ndarray of int
        The pixels, all with a point.
    """

    step: int
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]


def nominal_capture(result: SkullResult) -> Capture:
    """Return the capture of the sweep that was recorded as it is: that at the nominal exposure."""
    return min(result.sweep, key=lambda capture: abs(capture.exposure_ms - NOMINAL_EXPOSURE_MS))


def visible_views(result: SkullResult) -> tuple[FeatureView, ...]:
    """Return the views of the features that can be measured."""
    return tuple(view for view in result.views if view.visibility is Visibility.VISIBLE)


def object_crop(result: SkullResult) -> Crop:
    """Return a crop that holds all rings and nearly all points of the cloud, with a margin."""
    height, width = nominal_capture(result).image.shape
    views = visible_views(result)
    rows, columns = (
        np.concatenate([getattr(view, name) for view in views] or [np.zeros(0, dtype=np.int64)])
        for name in ("rows", "columns")
    )
    top, bottom = _extent(rows, np.nonzero(result.cloud.valid)[0], height)
    left, right = _extent(columns, np.nonzero(result.cloud.valid)[1], width)
    return Crop(top=top, bottom=bottom, left=left, right=right)


def _extent(rings: NDArray[np.int64], points: NDArray[np.int64], size: int) -> tuple[int, int]:
    ends = [*np.quantile(points, [_STRAY_SHARE, 1 - _STRAY_SHARE])] if points.size else []
    ends += [rings.min(), rings.max()] if rings.size else []
    if not ends:
        return 0, size
    return (
        max(0, math.floor(min(ends)) - _MARGIN_PX),
        min(size, math.ceil(max(ends)) + 1 + _MARGIN_PX),
    )


def ring_values(
    result: SkullResult, exposure_ms: float, column: str = "p_norm"
) -> dict[str, float]:
    """Return a column's value of every feature that was measured at an exposure time, by name."""
    table = result.table.measured()
    at_exposure = table.array(["exposure_ms"])[:, 0] == exposure_ms
    chosen = table.where(at_exposure)
    return dict(zip(chosen.names("feature").tolist(), chosen.array([column])[:, 0], strict=True))


def sample_cloud(result: SkullResult, crop: Crop, about: int) -> Sample:
    """Pick points of the nominal cloud evenly over the image.

    Parameters
    ----------
    result : SkullResult
        Its cloud is organised.
    crop : Crop
        Points outside are left out.
    about : int
        How many points, roughly.
    """
    valid = np.zeros_like(result.cloud.valid)
    inside = (slice(crop.top, crop.bottom), slice(crop.left, crop.right))
    valid[inside] = result.cloud.valid[inside]
    depth_mm = result.cloud.points[..., 2]
    if valid.any():
        near, far = np.quantile(depth_mm[valid], [_STRAY_SHARE, 1 - _STRAY_SHARE])
        valid &= (depth_mm >= near - _MARGIN_MM) & (depth_mm <= far + _MARGIN_MM)
    step = max(1, math.ceil(math.sqrt(np.count_nonzero(valid) / about)))
    rows, columns = np.nonzero(valid[::step, ::step])
    return Sample(step=step, rows=rows * step, columns=columns * step)

"""Point clouds, organised like their camera's image or not, with missing points as NaN."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import CloudError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """A point cloud in the frame of the sensor's first camera.

    Parameters
    ----------
    points : (rows, columns, 3) or (n, 3) ndarray, mm
        Organised like the first camera's image, or unorganised. Copied to float32 and made
        read-only. Missing points — all zero, or with a coordinate that is not finite — become NaN
        in all three coordinates. Points in metres must be converted before.

    Attributes
    ----------
    valid : (rows, columns) or (n,) ndarray of bool
        Where there is a point.

    Raises
    ------
    CloudError
        If the points have another shape or are not real numbers.
    """

    points: NDArray[np.float32]
    valid: NDArray[np.bool_] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = _checked(self.points)
        valid = ~np.isnan(points[..., 0])
        points.setflags(write=False)
        valid.setflags(write=False)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "valid", valid)

    @property
    def organised(self) -> bool:
        """True where the points keep the rows and columns of the image."""
        return self.points.ndim == 3

    @property
    def n_valid(self) -> int:
        """Number of points that are there."""
        return int(np.count_nonzero(self.valid))

    @property
    def valid_points(self) -> NDArray[np.float32]:
        """(n_valid, 3) mm: the points that are there, in row-major order."""
        return self.points[self.valid]

    def require_points(self) -> NDArray[np.float32]:
        """Return `valid_points`, of which there must be at least one.

        Raises
        ------
        CloudError
            If every point is missing.
        """
        points = self.valid_points
        if not len(points):
            msg = (
                f"the cloud has no valid point: all {self.valid.size} are NaN or zero; check the "
                "exposure and that the part was in the working volume"
            )
            raise CloudError(msg)
        return points

    def organise(self, rows: int, columns: int) -> Cloud:
        """Return the same points with an image's rows and columns.

        Parameters
        ----------
        rows, columns : int
            The image's size; the points must be in row-major order, missing ones included.

        Raises
        ------
        CloudError
            If there are not rows × columns points.
        """
        if rows < 1 or columns < 1 or rows * columns != self.valid.size:
            msg = (
                f"{rows} rows × {columns} columns need {rows * columns} points, missing ones "
                f"included, got {self.valid.size}; export the cloud with its missing points"
            )
            raise CloudError(msg)
        return Cloud(points=self.points.reshape(rows, columns, 3))


def _checked(points: ArrayLike) -> NDArray[np.float32]:
    """Return a float32 copy of points, missing ones NaN; sensors write them as 0 or infinity."""
    array = np.asarray(points)
    if array.ndim not in {2, 3} or array.shape[-1] != 3:
        msg = (
            "a cloud needs points of shape (rows, columns, 3) or (n, 3) in mm, got shape "
            f"{array.shape}"
        )
        raise CloudError(msg)
    if array.dtype.kind not in "fiu":
        msg = f"a cloud needs real numbers in mm, got an array of {array.dtype}"
        raise CloudError(msg)
    with np.errstate(over="ignore"):  # beyond float32 becomes infinite, and so missing
        copy = np.array(array, dtype=np.float32, order="C", copy=True)
    x, y, z = copy[..., 0], copy[..., 1], copy[..., 2]
    with np.errstate(over="ignore", invalid="ignore"):
        missing = ~np.isfinite(x + y + z) | ((x == 0) & (y == 0) & (z == 0))
    copy[missing] = np.nan
    return copy

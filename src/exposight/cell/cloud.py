"""Point clouds, organised like their camera's image or not; missing points are NaN."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exposight.compiled import njit
from exposight.errors import CloudError


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """A point cloud in the frame of the sensor's first camera.

    Parameters
    ----------
    points : (rows, columns, 3) or (n, 3) ndarray, mm
        Organised like the first camera's image, or unorganised. Copied to float32 and made
        read-only. Missing points — all zero, or with a coordinate that is not finite — become NaN
        in all three coordinates. Points in metres must be converted before.
    sigma_z_mm : (rows, columns) or (n,) ndarray, mm, optional
        Standard deviation of each point's z along its ray, where it is known; NaN where it is not.
        Copied to float32, made read-only, and NaN where there is no point.

    Attributes
    ----------
    valid : (rows, columns) or (n,) ndarray of bool
        Where there is a point.

    Raises
    ------
    CloudError
        If the points have another shape or are not real numbers, or the standard deviations are not
        one for each point, or below 0.
    """

    points: NDArray[np.float32]
    sigma_z_mm: NDArray[np.float32] | None = None
    valid: NDArray[np.bool_] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = _checked(self.points)
        valid = ~np.isnan(points[..., 0])
        points.setflags(write=False)
        valid.setflags(write=False)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "valid", valid)
        if self.sigma_z_mm is not None:
            object.__setattr__(self, "sigma_z_mm", _checked_sigma(self.sigma_z_mm, valid))

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
        sigma = self.sigma_z_mm
        return Cloud(
            points=self.points.reshape(rows, columns, 3),
            sigma_z_mm=None if sigma is None else sigma.reshape(rows, columns),
        )

    def with_sigma(self, sigma_z_mm: ArrayLike) -> Cloud:
        """Return the same points, unchecked anew, with the standard deviations of their depth.

        Parameters
        ----------
        sigma_z_mm : (rows, columns) or (n,) array, mm
            One for each point; of missing points they do not count.

        Raises
        ------
        CloudError
            If they are not of the points' shape, or below 0.
        """
        known = copy.copy(self)
        object.__setattr__(known, "sigma_z_mm", _checked_sigma(sigma_z_mm, self.valid))
        return known

    def scaled(self, factor: float) -> Cloud:
        """Return the cloud with all lengths times a factor, as from m to mm."""
        sigma = self.sigma_z_mm
        return Cloud(
            points=factor * self.points, sigma_z_mm=None if sigma is None else factor * sigma
        )


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
        checked = np.array(array, dtype=np.float32, order="C", copy=True)
    _mark_missing(checked.reshape(-1, 3))
    return checked


@njit()
def _mark_missing(points: NDArray[np.float32]) -> None:
    for point in points:
        x, y, z = point
        if not np.isfinite(x + y + z) or (x == 0.0 and y == 0.0 and z == 0.0):
            point[:] = np.nan


def _checked_sigma(sigma_mm: ArrayLike, valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return a float32 copy of standard deviations, NaN where there is no point."""
    array = np.asarray(sigma_mm)
    if array.shape != valid.shape or array.dtype.kind not in "fiu":
        msg = (
            f"sigma_z_mm needs a number in mm for each of the points, shape {valid.shape}, got "
            f"{array.dtype} of shape {array.shape}"
        )
        raise CloudError(msg)
    checked = np.where(valid, array, np.nan).astype(np.float32, copy=False)
    if (checked < 0.0).any():
        msg = f"sigma_z_mm needs standard deviations of 0 or more, got {np.nanmin(checked):g} mm"
        raise CloudError(msg)
    checked.setflags(write=False)
    return checked

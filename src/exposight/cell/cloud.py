"""Point clouds, organised like their camera's image or not, and their files (``docs/formats.md``).

Missing points are NaN. Every format (PLY, PCD, XYZ, CSV, NPY) keeps them, as NaN or zero, and the
order. PLY, PCD and NPY also keep the rows and columns of an organised cloud; the text formats
cannot, so their reader takes them from the caller. Coordinates are in mm. PLY keeps the points'
standard deviations, too.
"""

from __future__ import annotations

import codecs
import copy
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from pypcd4.pypcd4 import Encoding, PointCloud

from exposight.cell.cloud_signatures import cloud_kind
from exposight.cell.e57 import points_from_e57, split_scan
from exposight.cell.pcd import points_from_pcd
from exposight.cell.ply import ply_from_points, points_from_ply
from exposight.cell.text_clouds import TEXT_SUFFIXES, points_from_text
from exposight.compiled import njit
from exposight.errors import CloudError, DamagedFileError, FormatError
from exposight.files import read_bytes, write_durably


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


_CSV_COLUMNS = ("x_mm", "y_mm", "z_mm")


LENGTH_UNITS_MM: Mapping[str, float] = MappingProxyType({"mm": 1.0, "cm": 10.0, "m": 1000.0})
"""Units that the coordinates of a cloud's file may have, in mm."""


def read_cloud(
    path: Path,
    *,
    size: tuple[int, int] | None = None,
    unit: str = "mm",
    axes: Sequence[str] = ("x", "y", "z"),
) -> Cloud:
    """Read a point cloud; its content gives the format, and where that does not tell, its suffix.

    Parameters
    ----------
    path : Path
        A PLY, PCD, E57 (of several scans, ``name.e57#2`` the second), NPY or text file
        (``docs/formats.md``).
    size : (int, int), optional
        Rows and columns of the image, for an organised cloud whose file does not hold them.
    unit : {'mm', 'cm', 'm'}
        Unit of the file's coordinates, which files do not state; the cloud is in mm. E57 files are
        in m, always, and need it not.
    axes : (str, str, str)
        Which of the file's axes are x, y and z of the camera: ("x", "-y", "-z") for a file made
        for viewers that use OpenGL, whose y is up and whose z points towards the viewer.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If it is not what its suffix says, or another format; the message says what to export.
    InputError
        If it has several scans and none was chosen, or is an E57 file and pye57 is not installed.
    DamagedFileError
        If it is empty or cut off.
    CloudError
        If the number of points is not rows × columns, or the unit or an axis is another.
    """
    path, scan = split_scan(Path(path))
    if sorted(name.removeprefix("-") for name in axes) != ["x", "y", "z"]:
        msg = f"the axes of a cloud are x, y and z, each with or without -, got {' '.join(axes)}"
        raise CloudError(msg)
    if unit not in LENGTH_UNITS_MM:
        msg = f"the unit of a cloud must be {', '.join(LENGTH_UNITS_MM)}, got {unit!r}"
        raise CloudError(msg)
    data = read_bytes(path, "point cloud").removeprefix(codecs.BOM_UTF8)
    if not data:
        msg = f"{path} is empty; expected a {path.suffix} point cloud: copy or export it again"
        raise DamagedFileError(msg)
    kind = cloud_kind(data, path, READ_SUFFIXES)
    try:
        if kind == ".e57":
            cloud, unit = _read_e57(path, scan, unit), "mm"
        elif kind in TEXT_SUFFIXES:  # whose header may tell units, and pixels of an image
            cloud = Cloud(points=points_from_text(data, path, size=size, unit=unit))
            unit = "mm"
        else:
            cloud = _FORMATS[kind][0](data, path)
        if unit != "mm":
            cloud = cloud.scaled(LENGTH_UNITS_MM[unit])
        if tuple(axes) != ("x", "y", "z"):
            order = ["xyz".index(name.removeprefix("-")) for name in axes]
            signs = np.array([-1.0 if name.startswith("-") else 1.0 for name in axes], np.float32)
            cloud = replace(cloud, points=cloud.points[..., order] * signs)
        return cloud if size is None else cloud.organise(*size)
    except CloudError as error:
        msg = f"{path}: {error}"
        raise CloudError(msg) from error


def write_cloud(path: Path, cloud: Cloud) -> None:
    """Write a point cloud in mm; the file's suffix gives its format.

    The file is whole or absent. Missing points are written as NaN, so that the order stays.

    Parameters
    ----------
    path : Path
        A .ply, .pcd, .xyz, .txt, .csv or .npy file; PLY and PCD are written in binary.
    cloud : Cloud
        The points; the text formats (.xyz, .txt, .csv) keep their order but not their rows and
        columns, and only .ply keeps ``sigma_z_mm``.

    Raises
    ------
    FormatError
        If the suffix is another one.
    FileError
        If the disk refuses.
    """
    path = Path(path)
    write_durably(path, _writer(path)(cloud))


_Read = Callable[[bytes, Path], Cloud]
_Write = Callable[[Cloud], bytes]


def _writer(path: Path) -> _Write:
    """Return the writer of the format that a file's suffix gives."""
    if path.suffix.lower() in _FORMATS:
        return _FORMATS[path.suffix.lower()][1]
    msg = (
        f"{path}: point clouds are written as {', '.join(CLOUD_SUFFIXES)}, got the suffix "
        f"{path.suffix!r}; name it so"
    )
    raise FormatError(msg)


# -- PCD ----------------------------------------------------------------------------------------


def _read_pcd(data: bytes, path: Path) -> Cloud:
    return Cloud(points=points_from_pcd(data, path))


def _pcd(cloud: Cloud) -> bytes:
    points = cloud.points
    written = PointCloud.from_xyz_points(points.reshape(-1, 3))
    height, width = points.shape[:2] if points.ndim == 3 else (1, len(points))
    written.metadata = written.metadata.derive(height=height, width=width)
    buffer = io.BytesIO()
    written.save(buffer, encoding=Encoding.BINARY)
    return buffer.getvalue()


# -- E57 ----------------------------------------------------------------------------------------


def _read_e57(path: Path, scan: int | None, unit: str) -> Cloud:
    if unit == "cm":
        msg = "E57 files are in m by their standard; leave out the unit"
        raise CloudError(msg)
    return Cloud(points=points_from_e57(path, scan))


# -- text ---------------------------------------------------------------------------------------


def _read_text(data: bytes, path: Path) -> Cloud:
    return Cloud(points=points_from_text(data, path))


def _write_text(separator: str, header: bool, cloud: Cloud) -> bytes:
    frame = pl.DataFrame(cloud.points.reshape(-1, 3), schema=list(_CSV_COLUMNS))
    buffer = io.BytesIO()
    frame.write_csv(buffer, separator=separator, include_header=header)
    return buffer.getvalue()


_xyz, _csv = partial(_write_text, " ", False), partial(_write_text, ",", True)


# -- NPY ----------------------------------------------------------------------------------------


def _read_npy(data: bytes, path: Path) -> Cloud:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        msg = (
            f"{path} cannot be read as NPY ({error}); expected an array of numbers of shape "
            "(rows, columns, 3) or (n, 3) in mm, without pickled objects"
        )
        kind = DamagedFileError if data.startswith(b"\x93NUMPY") else FormatError
        raise kind(msg) from error
    if not isinstance(array, np.ndarray):
        array.close()
        msg = f"{path} is an archive of several arrays (NPZ); expected one array (NPY)"
        raise FormatError(msg)
    return Cloud(points=array)


def _npy(cloud: Cloud) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, cloud.points, allow_pickle=False)
    return buffer.getvalue()


# -- PLY ----------------------------------------------------------------------------------------


def _read_ply(data: bytes, path: Path) -> Cloud:
    points, sigma = points_from_ply(data, path)
    return Cloud(points=points, sigma_z_mm=sigma)


def _ply(cloud: Cloud) -> bytes:
    return ply_from_points(cloud.points, cloud.sigma_z_mm)


_FORMATS: dict[str, tuple[_Read, _Write]] = {
    ".ply": (_read_ply, _ply),
    ".pcd": (_read_pcd, _pcd),
    ".xyz": (_read_text, _xyz),
    ".txt": (_read_text, _xyz),
    ".csv": (_read_text, _csv),
    ".asc": (_read_text, _xyz),
    ".pts": (_read_text, _xyz),
    ".npy": (_read_npy, _npy),
}

CLOUD_SUFFIXES: tuple[str, ...] = tuple(_FORMATS)
"""File suffixes of the point-cloud formats that can be read and written."""

READ_SUFFIXES: tuple[str, ...] = (*CLOUD_SUFFIXES, ".e57")
"""File suffixes of the point-cloud formats that can be read."""

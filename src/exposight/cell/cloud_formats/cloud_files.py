"""Files of point clouds (``docs/formats.md``), known by content and suffix.

Every format (PLY, PCD, XYZ, CSV, NPY) keeps missing points, as NaN or zero, and the order. PLY, PCD
and NPY also keep the rows and columns of an organised cloud; the text formats cannot, so their
reader takes them from the caller. Coordinates are in mm. PLY keeps the points' standard deviations,
too.
"""

import codecs
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from pypcd4.pypcd4 import Encoding, PointCloud

from exposight.cell.cloud import Cloud
from exposight.cell.cloud_formats.cloud_signatures import cloud_kind
from exposight.cell.cloud_formats.e57 import points_from_e57, split_scan
from exposight.cell.cloud_formats.pcd import points_from_pcd
from exposight.cell.cloud_formats.ply import ply_from_points, points_from_ply
from exposight.cell.cloud_formats.text_clouds import TEXT_SUFFIXES, points_from_text
from exposight.errors import CloudError, DamagedFileError, FormatError
from exposight.files import read_bytes, write_durably

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

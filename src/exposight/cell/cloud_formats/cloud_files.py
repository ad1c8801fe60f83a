"""Files of point clouds (``docs/formats.md``), known by content and suffix.

Every format (PLY, PCD, XYZ, CSV, NPY) keeps missing points, as NaN or zero, and the order. PLY, PCD
and NPY also keep the rows and columns of an organised cloud; the text formats cannot, so their
reader takes them from the caller. Coordinates are in mm. PLY keeps the points' standard deviations,
too.
"""

import codecs
import io
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
from pypcd4.pypcd4 import Encoding, PointCloud

from exposight.cell.cloud import Cloud
from exposight.cell.cloud_formats.e57 import SIGNATURE, points_from_e57, split_scan
from exposight.cell.cloud_formats.fill_points import fill_point
from exposight.cell.cloud_formats.pcd import is_pcd, points_from_pcd
from exposight.cell.cloud_formats.ply import ply_from_points, points_from_ply
from exposight.cell.cloud_formats.text_clouds import TEXT_SUFFIXES, points_from_text
from exposight.errors import CloudError, DamagedFileError, FormatError
from exposight.files import (
    UNITS_MM,
    parsing,
    read_array,
    read_bytes,
    recognised,
    write_durably,
)

_CSV_COLUMNS = ("x_mm", "y_mm", "z_mm")

_Read = Callable[[bytes, Path], Cloud]
_Write = Callable[[Cloud], bytes]

LENGTH_UNITS_MM: Mapping[str, float] = MappingProxyType(
    {unit: UNITS_MM[unit] for unit in ("mm", "cm", "m")}
)
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
    kind = _kind(data, path)
    try:
        # Numbers beyond float32 become infinite, and so missing.
        with parsing(path, f"{kind[1:].upper()} point cloud"), np.errstate(all="ignore"):
            if kind == ".e57":
                cloud, unit = _read_e57(data, path, scan, unit), "mm"
            elif kind in TEXT_SUFFIXES:  # whose header may tell units, and pixels of an image
                cloud = Cloud(points=points_from_text(data, path, size=size, unit=unit))
                unit = "mm"
            else:
                cloud = _READERS[kind](data, path)
            cloud = _without_fill(cloud, path)
            if unit != "mm":
                cloud = cloud.scaled(LENGTH_UNITS_MM[unit])
        if tuple(axes) != ("x", "y", "z"):
            cloud = _turned(cloud, axes)
        return cloud if size is None else cloud.organise(*size)
    except CloudError as error:
        msg = f"{path}: {error}"
        raise CloudError(msg) from error


def _turned(cloud: Cloud, axes: Sequence[str]) -> Cloud:
    order = ["xyz".index(name.removeprefix("-")) for name in axes]
    signs = np.array([-1.0 if name.startswith("-") else 1.0 for name in axes], np.float32)
    return replace(cloud, points=cloud.points[..., order] * signs)


def _without_fill(cloud: Cloud, path: Path) -> Cloud:
    """Return a cloud without points at a place that stands for missing ones."""
    place = fill_point(cloud.points)
    if place is None:
        return cloud
    missing = (cloud.points == place).all(axis=-1)
    shown = ", ".join(f"{x:g}" for x in place)
    recognised(path, f"{missing.sum()} points at ({shown}) taken as missing")
    points = np.where(missing[..., None], np.float32(np.nan), cloud.points)
    sigma = cloud.sigma_z_mm
    return Cloud(
        points=points, sigma_z_mm=None if sigma is None else np.where(missing, np.nan, sigma)
    )


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
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        msg = (
            f"{path}: point clouds are written as {', '.join(CLOUD_SUFFIXES)}, got the suffix "
            f"{path.suffix!r}; name it so"
        )
        raise FormatError(msg)
    write_durably(path, writer(cloud))


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


def _read_e57(data: bytes, path: Path, scan: int | None, unit: str) -> Cloud:
    if unit == "cm":
        msg = "E57 files are in m by their standard; leave out the unit"
        raise CloudError(msg)
    return Cloud(points=points_from_e57(data, path, scan))


def _write_text(separator: str, header: bool, cloud: Cloud) -> bytes:
    frame = pl.DataFrame(cloud.points.reshape(-1, 3), schema=list(_CSV_COLUMNS))
    buffer = io.BytesIO()
    frame.write_csv(buffer, separator=separator, include_header=header)
    return buffer.getvalue()


_xyz, _csv = partial(_write_text, " ", False), partial(_write_text, ",", True)


def _read_npy(data: bytes, path: Path) -> Cloud:
    return Cloud(points=read_array(data, path, "point cloud"))


def _npy(cloud: Cloud) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, cloud.points, allow_pickle=False)
    return buffer.getvalue()


def _read_ply(data: bytes, path: Path) -> Cloud:
    points, sigma = points_from_ply(data, path)
    return Cloud(points=points, sigma_z_mm=sigma)


def _ply(cloud: Cloud) -> bytes:
    return ply_from_points(cloud.points, cloud.sigma_z_mm)


_READERS: Mapping[str, _Read] = {".ply": _read_ply, ".pcd": _read_pcd, ".npy": _read_npy}
_WRITERS: Mapping[str, _Write] = {
    ".ply": _ply,
    ".pcd": _pcd,
    **dict.fromkeys(TEXT_SUFFIXES, _xyz),
    ".csv": _csv,
    ".npy": _npy,
}

CLOUD_SUFFIXES: tuple[str, ...] = tuple(_WRITERS)
"""File suffixes of the point-cloud formats that can be read and written."""

READ_SUFFIXES: tuple[str, ...] = (*CLOUD_SUFFIXES, ".e57")
"""File suffixes of the point-cloud formats that can be read."""

_CLOUDS: tuple[tuple[bytes, str], ...] = (
    *((b"ply" + end, ".ply") for end in (b"\n", b"\r", b" ")),
    (b"\x93NUMPY", ".npy"),
    (SIGNATURE, ".e57"),
)

_KEEP = "keeping missing points so that it stays organised"
_MESH = (
    "a mesh, whose points have lost their pixels: export the scanner's cloud, before it is meshed, "
    f"as PLY or PCD, {_KEEP}; a part's own geometry is no capture"
)
_LAS = "a LAS or LAZ file, which has no missing points: export E57, PLY or PCD instead"
_ZDF = "a Zivid file: export it from Zivid Studio as an organised PLY or PCD (File > Export)"
_IMAGE = (
    "an image: a depth image needs its camera (observe --cloud IMAGE --depth-scale MM, in Python "
    "read_depth_cloud)"
)
_EXR = "an EXR image: save its depth as TIFF of 32 bits or as NPY, and give --depth-scale"
_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"LASF", _LAS),
    (b"\x89HDF", _ZDF),
    (b"glTF", _MESH),
    (b"\x89PNG", _IMAGE),
    (b"\xff\xd8\xff", _IMAGE),
    (b"II*\0", _IMAGE),
    (b"MM\0*", _IMAGE),
    (b"BM", _IMAGE),
    (b"\x76\x2f\x31\x01", _EXR),
    (b"MATLAB 5.0", "a MATLAB file: save the array as NPY, PLY or CSV"),
    (b"\xd0\xcf\x11\xe0", "a workbook or another document of Office: save its sheet as CSV"),
)
_BY_SUFFIX = {
    **dict.fromkeys((".stl", ".obj", ".glb", ".gltf", ".3mf", ".step", ".stp", ".off"), _MESH),
    **dict.fromkeys((".las", ".laz"), _LAS),
    **dict.fromkeys((".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp"), _IMAGE),
    ".exr": _EXR,
    ".zdf": _ZDF,
    **dict.fromkeys(
        (".xlsx", ".xls", ".ods"), "a workbook: save its sheet as CSV, with x, y and z as columns"
    ),
    **dict.fromkeys(
        (".mrp", ".mraw", ".bag", ".db3", ".praw", ".zmp"),
        "a recording of a vendor's own program: export its cloud as PLY or PCD there",
    ),
}


def _kind(data: bytes, path: Path) -> str:
    """Return the suffix that stands for the format of a cloud's content, which is not empty.

    Raises
    ------
    FormatError
        If it is no cloud; the message says what to export instead.
    """
    suffix = path.suffix.lower()
    found = next((kind for start, kind in _CLOUDS if data.startswith(start)), "")
    if not found and is_pcd(data):
        found = ".pcd"
    if found:
        if suffix != found:
            recognised(path, f"a {found[1:].upper()} file by its content")
        return found
    advice = next((text for start, text in _OTHERS if data.startswith(start)), "")
    if suffix in READ_SUFFIXES and suffix != ".npy" and advice is _IMAGE and data.startswith(b"BM"):
        advice = ""  # a text may begin so
    if not advice and _is_stl(data):
        advice = _MESH
    if not advice and suffix in READ_SUFFIXES:
        return suffix
    advice = advice or _BY_SUFFIX.get(suffix, "")
    if not advice and _is_text(data):
        recognised(path, "text by its content")
        return ".xyz"
    msg = f"{path}: point clouds are read as {', '.join(READ_SUFFIXES)}, got " + (
        advice or f"the suffix {path.suffix!r}; convert it, {_KEEP}"
    )
    raise FormatError(msg)


def _is_stl(data: bytes) -> bool:
    if data.startswith(b"solid") and b"facet" in data[:1024]:
        return True
    if len(data) < 84:
        return False
    (triangles,) = struct.unpack("<I", data[80:84])
    return bool(triangles > 0 and len(data) == 84 + 50 * triangles)


def _is_text(data: bytes) -> bool:
    start = data[:4096]
    return b"\0" not in start and any(byte in b"0123456789" for byte in start)

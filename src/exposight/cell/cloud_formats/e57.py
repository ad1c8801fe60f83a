"""E57 point clouds (ASTM E2807), through pye57 of the extra ``exposight[e57]``.

Lengths in E57 files are metres, always. A scan's points are in its own frame, that of the sensor;
where it stands in the file's frame (its pose) does not matter here.
"""

import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import DamagedFileError, FormatError, InputError
from exposight.files import parse_apart, recognised

SIGNATURE = b"ASTM-E57"
"""First bytes of an E57 file."""

_AXES = ("cartesianX", "cartesianY", "cartesianZ")
_INVALID, _ROW, _COLUMN = "cartesianInvalidState", "rowIndex", "columnIndex"
_SPARSE = 64
"""Pixels to a point, at most, of a grid that is taken for an image."""

_PARSER = Path(__file__).with_name("e57_parser.py")
_SECONDS, _SECONDS_PER_MB = 9.0, 1.0
_GB, _GB_PER_GB = 0.4, 150.0
"""Time and memory that a file may take to be read: points packed into three bytes become six
columns of eight, which are held three times when they are handed over."""


def split_scan(path: Path) -> tuple[Path, int | None]:
    """Return the file and the number of the scan, from 1, in a path such as ``cell.e57#2``."""
    name, mark, number = path.name.rpartition("#")
    if mark and number.isdecimal() and name.lower().endswith(".e57") and not path.exists():
        return path.with_name(name), int(number)
    return path, None


def points_from_e57(data: bytes, path: Path, scan: int | None = None) -> NDArray[np.floating]:
    """Return a scan of an E57 file.

    Parameters
    ----------
    data : bytes
        The whole file.
    path : Path
        Its name, for messages.
    scan : int, optional
        Which of its scans, from 1; needed where there are several.

    Returns
    -------
    (rows, columns, 3) or (n, 3) ndarray, mm
        In the scan's own frame, NaN where it says that a point is invalid. Organised where each
        point has a row and a column of its own.

    Raises
    ------
    InputError
        If pye57 is not installed, or there are several scans and none was chosen.
    FormatError
        If it has no such scan, no Cartesian coordinates, or cannot be parsed.
    DamagedFileError
        If it is cut off.
    """
    told = _parsed(data, path, scan)
    n_scans = int(told["scans"])
    if "fields" not in told and 1 <= (scan or 1) <= n_scans:
        msg = (
            f"{path} holds {n_scans} scans, each a cloud of its own; say which one it is: "
            f"{path.name}#1 to {path.name}#{n_scans}"
        )
        raise InputError(msg)
    if "fields" not in told:
        msg = f"{path}: expected the scan {scan or 1}, the file has {n_scans}"
        raise FormatError(msg)
    fields = told["fields"].tolist()
    if not set(_AXES) <= set(fields):
        msg = (
            f"{path}: expected points with {', '.join(_AXES)}, got {', '.join(fields)}; export "
            "Cartesian coordinates"
        )
        raise FormatError(msg)
    announced = int(told["announced"])
    if "found" not in told or told["found"] != announced:
        holds = f"it holds {told['found']}" if "found" in told else "more than its bytes can hold"
        msg = f"{path} is cut off or wrong: it announces {announced} points, {holds}; copy it again"
        raise DamagedFileError(msg)
    points = 1000.0 * np.stack([told[axis] for axis in _AXES], axis=-1)
    if _INVALID in told:
        points[told[_INVALID] != 0] = np.nan
    remarks = ["m converted to mm, as E57 has them"]
    if told["turned"]:
        remarks.append("points in the scan's own frame, its pose in the file is not applied")
    if {_ROW, _COLUMN} <= told.keys():
        index = np.stack([told[_ROW], told[_COLUMN]], axis=-1).astype(np.int64)
        low, high = told["bounds"].reshape(2, -1).astype(np.int64)
        points = _organised(points, index, low, high, remarks)
    recognised(path, *remarks)
    return points


def _parsed(data: bytes, path: Path, scan: int | None) -> dict[str, NDArray[Any]]:
    """Return what the parser, in a process of its own, makes of a file."""
    try:
        found = find_spec("pye57") is not None
    except ValueError:
        found = False
    if not found:
        msg = (
            f"{path}: E57 files are read by pye57, which is not installed: pip install "
            "'exposight[e57]', or export the cloud as PLY with its missing points"
        )
        raise InputError(msg)
    with tempfile.TemporaryDirectory() as folder:
        return parse_apart(
            _PARSER,
            data,
            source=path,
            what="E57 point cloud",
            seconds=_SECONDS + _SECONDS_PER_MB * len(data) / 1e6,
            memory_gb=_GB + _GB_PER_GB * len(data) / 1e9,
            folder=folder,
            scan=str(scan or ""),
        )


def _organised(
    points: NDArray[np.float64],
    index: NDArray[np.int64],
    low: NDArray[np.int64],
    high: NDArray[np.int64],
    remarks: list[str],
) -> NDArray[np.float64]:
    """Return points at their rows and columns, or as they are where these are no image's."""
    if len(points) == 0:
        return points
    if low.size == 0 or (index < low).any() or (index > high).any():
        low, high = index.min(axis=0), index.max(axis=0)
    first = low
    rows, columns = (int(end) - int(start) + 1 for start, end in zip(low, high, strict=True))
    if min(rows, columns) < 2 or rows * columns > _SPARSE * len(points):
        return points
    place = (index[:, 0] - first[0]) * columns + index[:, 1] - first[1]
    if first.any() and len(points) < rows * columns:
        # Writers that keep valid points alone tell the rows and columns that these reach over.
        remarks.append("without rows and columns, for its indices begin within the image")
        return points
    if len(np.unique(place)) < len(place):
        remarks.append("without rows and columns, which several points share")
        return points
    organised = np.full((rows * columns, 3), np.nan)
    organised[place] = points
    remarks.append(f"{rows} rows × {columns} columns as its indices say")
    return organised.reshape(rows, columns, 3)

"""E57 point clouds (ASTM E2807), through pye57 of the extra ``exposight[e57]``.

Lengths in E57 files are metres, always. A scan's points are in its own frame, that of the sensor;
where it stands in the file's frame (its pose) does not matter here.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import DamagedFileError, FormatError, InputError
from exposight.files import recognised

SIGNATURE = b"ASTM-E57"
"""First bytes of an E57 file."""

_AXES = ("cartesianX", "cartesianY", "cartesianZ")
_INVALID, _ROW, _COLUMN = "cartesianInvalidState", "rowIndex", "columnIndex"
_LEAST_BYTES = 3
"""Of a point in a file: fewer than a byte for each coordinate cannot hold it."""
_SPARSE = 64
"""Pixels to a point, at most, of a grid that is taken for an image."""


def split_scan(path: Path) -> tuple[Path, int | None]:
    """Return the file and the number of the scan, from 1, in a path such as ``cell.e57#2``."""
    name, mark, number = path.name.rpartition("#")
    if mark and number.isdecimal() and name.lower().endswith(".e57") and not path.exists():
        return path.with_name(name), int(number)
    return path, None


def points_from_e57(path: Path, scan: int | None = None) -> NDArray[np.floating]:
    """Read a scan of an E57 file.

    Parameters
    ----------
    path : Path
        The file.
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
        If it has no such scan, or no Cartesian coordinates.
    DamagedFileError
        If it cannot be read to its end.
    """
    with _opened(path) as file:
        n_scans = int(file.scan_count)
        if n_scans == 0 or (scan is not None and not 1 <= scan <= n_scans):
            msg = f"{path}: expected the scan {scan or 1}, the file has {n_scans}"
            raise FormatError(msg)
        if scan is None and n_scans > 1:
            msg = (
                f"{path} holds {n_scans} scans, each a cloud of its own; say which one it is: "
                f"{path.name}#1 to {path.name}#{n_scans}"
            )
            raise InputError(msg)
        header = file.get_header((scan or 1) - 1)
        if not set(_AXES) <= set(header.point_fields):
            msg = (
                f"{path}: expected points with {', '.join(_AXES)}, got "
                f"{', '.join(header.point_fields)}; export Cartesian coordinates"
            )
            raise FormatError(msg)
        n_points = int(header.point_count)
        if _LEAST_BYTES * n_points > path.stat().st_size:
            msg = (
                f"{path} is cut off or wrong: it announces {n_points} points, more than a file of "
                f"its {path.stat().st_size} bytes can hold; copy or export it again"
            )
            raise DamagedFileError(msg)
        wanted = [*_AXES, *({_INVALID, _ROW, _COLUMN} & set(header.point_fields))]
        data, buffers = file.make_buffers(wanted, n_points)
        found = int(header.points.reader(buffers).read()) if n_points else 0
        first, size = _bounds(header)
        turned = header.has_pose() and not (
            np.allclose(header.translation, 0.0) and np.allclose(header.rotation_matrix, np.eye(3))
        )
    if found < n_points:
        msg = f"{path} is cut off: it announces {n_points} points, it holds {found}; copy it again"
        raise DamagedFileError(msg)
    points = 1000.0 * np.stack([data[axis] for axis in _AXES], axis=-1)
    if _INVALID in data:
        points[data[_INVALID] != 0] = np.nan
    remarks = ["m converted to mm, as E57 has them"]
    if turned:
        remarks.append("points in the scan's own frame, its pose in the file is not applied")
    if {_ROW, _COLUMN} <= data.keys():
        index = np.stack([data[_ROW], data[_COLUMN]], axis=-1).astype(np.int64)
        points = _organised(points, index, first, size, remarks)
    recognised(path, *remarks)
    return points


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a file; whatever the library raises becomes an error that names it."""
    try:
        import pye57
    except ImportError as error:
        msg = (
            f"{path}: E57 files are read by pye57, which is not installed: pip install "
            "'exposight[e57]', or export the cloud as PLY with its missing points"
        )
        raise InputError(msg) from error
    try:
        with pye57.E57(str(path)) as file:
            yield file
    except (pye57.libe57.E57Exception, RuntimeError, ValueError, TypeError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        msg = f"{path} is no E57 file, or is damaged ({reason}); copy or export it again"
        raise DamagedFileError(msg) from error


def _bounds(header: Any) -> tuple[NDArray[np.int64] | None, NDArray[np.int64] | None]:
    """Return the first row and column, and the number of both, that a scan announces."""
    if not header.node.isDefined("indexBounds"):
        return None, None
    bounds = header["indexBounds"]
    names = ("rowMinimum", "columnMinimum", "rowMaximum", "columnMaximum")
    if not all(bounds.isDefined(name) for name in names):
        return None, None
    low_row, low_column, high_row, high_column = (int(bounds[name].value()) for name in names)
    first = np.array([low_row, low_column])
    return first, np.array([high_row, high_column]) - first + 1


def _organised(
    points: NDArray[np.float64],
    index: NDArray[np.int64],
    first: NDArray[np.int64] | None,
    size: NDArray[np.int64] | None,
    remarks: list[str],
) -> NDArray[np.float64]:
    """Return points at their rows and columns, or as they are where these are no image's."""
    if len(points) == 0:
        return points
    if first is None or size is None or (index < first).any() or (index >= first + size).any():
        first = index.min(axis=0)
        size = index.max(axis=0) - first + 1
    rows, columns = (int(n) for n in size)
    place = (index[:, 0] - first[0]) * columns + index[:, 1] - first[1]
    if min(rows, columns) < 2 or rows * columns > _SPARSE * len(points):
        return points
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

"""Reads a scan of an E57 file by pye57, in a process of its own (`files.parse_apart`).

Its XML and its packets are parsed by native libraries that nobody can check beforehand.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pye57

AXES = ("cartesianX", "cartesianY", "cartesianZ")
INVALID, ROW, COLUMN = "cartesianInvalidState", "rowIndex", "columnIndex"
_LEAST_BYTES = 3
"""Of a point in a file: fewer than a byte for each coordinate cannot hold it."""
_BOUNDS = ("rowMinimum", "columnMinimum", "rowMaximum", "columnMaximum")


def parse(data: bytes, *, folder: str, scan: str) -> dict[str, Any]:
    """Return a scan's columns by their names, and what the file says of it.

    Parameters
    ----------
    data : bytes
        The file.
    folder : str
        Where it may be put down.
    scan : str
        Number of the scan, from 1; empty where none was chosen.

    Returns
    -------
    dict
        ``scans``, how many there are. Of the chosen or only one ``fields``, ``announced`` points,
        ``turned`` by a pose, ``bounds`` of rows and columns; ``found`` points and their columns
        where the file can hold them.
    """
    path = Path(folder) / "scan.e57"
    path.write_bytes(data)
    with pye57.E57(str(path)) as file:
        answer: dict[str, Any] = {"scans": int(file.scan_count)}
        chosen = int(scan or 1)
        if not 1 <= chosen <= answer["scans"] or (not scan and answer["scans"] > 1):
            return answer
        header = file.get_header(chosen - 1)
        fields = [str(name) for name in header.point_fields]
        answer |= {"fields": np.array(fields), "announced": int(header.point_count)}
        if not set(AXES) <= set(fields) or not _holds(data, answer["announced"]):
            return answer
        answer["turned"] = header.has_pose() and not (
            np.allclose(header.translation, 0.0) and np.allclose(header.rotation_matrix, np.eye(3))
        )
        answer["bounds"] = _bounds(header)
        wanted = [*AXES, *sorted({INVALID, ROW, COLUMN} & set(fields))]
        columns, buffers = file.make_buffers(wanted, answer["announced"])
        read = int(header.points.reader(buffers).read()) if answer["announced"] else 0
        return {**answer, "found": read, **columns}


def _holds(data: bytes, points: int) -> bool:
    return 0 <= _LEAST_BYTES * points <= len(data)


def _bounds(header: Any) -> list[int]:
    """Return least and greatest row and column that a scan announces, or nothing."""
    if not header.node.isDefined("indexBounds"):
        return []
    bounds = header["indexBounds"]
    if not all(bounds.isDefined(name) for name in _BOUNDS):
        return []
    return [int(bounds[name].value()) for name in _BOUNDS]

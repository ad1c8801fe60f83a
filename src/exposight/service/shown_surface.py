"""A part's surface with so few triangles that a page draws it at once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.errors import ExposightError
from exposight.files import read_bytes, write_durably
from exposight.report.part_plot import shading

SURFACE_FILE = "surface.json"
"""In a run's folder."""

_MOST_TRIANGLES = 3000
_FINEST = 300
"""Cells of the grid along the part's longest side, at most."""

_LIMIT_BYTES = 4_000_000


def coarse_surface(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], most: int = _MOST_TRIANGLES
) -> dict[str, Any]:
    """Return a surface of few triangles: vertices in a cell of a grid become their mean.

    Parameters
    ----------
    vertices : (n, 3) ndarray, mm
    faces : (m, 3) ndarray of int
        Triangles.
    most : int
        Triangles that may be left.

    Returns
    -------
    dict
        ``vertices``, x, y and z in mm one after the other; ``triangles``, three indices each, one
        after the other; ``shade``, how bright each vertex is drawn, 0 to 1.
    """
    if len(faces) > most:  # once for what is far too fine, then as fine as may be
        vertices, faces = _clustered(vertices, faces, _FINEST)
    # Shaded as the fine surface is: normals of what is left of it would make it look battered.
    shade = shading(vertices.astype(np.float32), faces)
    vertices = np.column_stack([vertices, shade])
    low, high = 1, _FINEST
    best = _clustered(vertices, faces, low)
    while low < high:
        cells = (low + high + 1) // 2
        tried = _clustered(vertices, faces, cells)
        if len(tried[1]) <= most:
            low, best = cells, tried
        else:
            high = cells - 1
    points, triangles = best
    return {
        "vertices": np.round(points[:, :3], 1).ravel().tolist(),
        "triangles": triangles.ravel().tolist(),
        "shade": np.round(points[:, 3], 2).tolist(),
    }


def _clustered(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], cells: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return means of the vertices in cells of a grid, and the triangles that are left of them.

    Further columns than x, y and z are averaged, too.
    """
    places_mm = vertices[:, :3] - vertices[:, :3].min(axis=0)
    size_mm = max(float(places_mm.max()) / cells, 1e-9)
    places = np.floor(places_mm / size_mm).astype(np.int64)
    keys = (places * [1, cells + 2, (cells + 2) ** 2]).sum(axis=1)
    _, cell_of, counts = np.unique(keys, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(cell_of, axis) / counts for axis in vertices.T], axis=1)
    moved = cell_of[faces]
    apart = (moved != np.roll(moved, 1, axis=1)).all(axis=1)
    moved = moved[apart]
    # The two sides of a sheet that is thinner than a cell are one.
    _, first = np.unique(np.sort(moved, axis=1), axis=0, return_index=True)
    moved = moved[np.sort(first)]
    used, triangles = np.unique(moved, return_inverse=True)
    return means[used], triangles.reshape(-1, 3).astype(np.int32)


def write_surface(folder: Path, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    """Write a part's coarse surface into a run's folder; one that is there stays.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    path = folder / SURFACE_FILE
    if not path.exists():
        text = json.dumps(coarse_surface(vertices, faces), separators=(",", ":"))
        write_durably(path, text.encode())


def read_surface(folder: Path) -> dict[str, Any] | None:
    """Return the surface in a run's folder; None where there is none, or no such."""
    path = folder / SURFACE_FILE
    if not path.is_file() or path.stat().st_size > _LIMIT_BYTES:
        return None
    try:
        surface = json.loads(read_bytes(path, "surface"))
    except (ExposightError, ValueError):
        return None
    return surface if isinstance(surface, dict) and "triangles" in surface else None

"""The page of a part from CAD: its mesh in 3D, and the features that were found on it."""

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.cell import Feature, Part
from exposight.files import write_durably
from exposight.report.found_features_plot import found_features_plot
from exposight.report.rendering import render_page
from exposight.tables import counted

_MOST_TRIANGLES = 60_000
"""More would make the page slow; the drawing alone is thinned."""

_KINDS = {"hole": "hole", "slot": "slot", "pocket": "cutout", "sphere": "ball"}
"""What kinds of features are called; others by their own name."""


def write_part_page(
    path: Path,
    part: Part,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    rows: Sequence[dict[str, Any]],
    notes: Sequence[str] = (),
    unlisted: int | None = None,
) -> None:
    """Write the page: one file that opens without a network.

    Parameters
    ----------
    path : Path
        What is there is replaced.
    part : Part
        Its features are drawn.
    vertices : (n, 3) ndarray, mm
    faces : (m, 3) ndarray of int32
        The part's mesh.
    rows : sequence of dict
        The table of features.
    notes : sequence of str
        What was mended, and what was left out.
    unlisted : int, optional
        Holes of the part that the user's list does not name; None where there is no list.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    shown_vertices, shown_faces = thinned(vertices, faces, _MOST_TRIANGLES)
    size = np.ptp(vertices, axis=0)
    page = render_page(
        "part.html",
        title=part.name,
        lead=f"A part of {' × '.join(f'{extent:.4g}' for extent in size)} mm "
        f"({counted(len(faces), 'triangle')}), and what was found on it.",
        statement=found_sentence(part.features, unlisted),
        drawing=found_features_plot(part.features, shown_vertices, shown_faces),
        thinned=len(shown_faces) < len(faces),
        rows=rows,
        notes=notes,
        facts=(),
    )
    write_durably(path, page.encode())


def found_sentence(features: Sequence[Feature], unlisted: int | None = None) -> str:
    """Say what was found: "35 holes, 2 slots and 1 cutout were found."."""
    kinds = Counter(_KINDS.get(feature.kind, feature.kind) for feature in features)
    *most, last = [counted(n, kind) for kind, n in kinds.most_common()]
    named = f"{', '.join(most)} and {last}" if most else last
    were = "was" if len(features) == 1 else "were"
    if unlisted is None:
        return f"{named} {were} found."
    rest = (
        "it has no other" if not unlisted else f"{counted(unlisted, 'hole')} of it not in the list"
    )
    return f"{named} of the list {were} found on the part; {rest}."


def thinned(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], most: int
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return a mesh of at most so many triangles: vertices in one cell of a grid become one."""
    if len(faces) <= most:
        return vertices.astype(np.float32), faces
    low = vertices.min(axis=0)
    extent = float(np.ptp(vertices, axis=0).max())
    n_cells = math.ceil(math.sqrt(most / 2))
    while True:
        cells = ((vertices - low) * (n_cells / extent)).astype(np.int64)
        keys = (cells[:, 0] * (n_cells + 1) + cells[:, 1]) * (n_cells + 1) + cells[:, 2]
        _, first, number = np.unique(keys, return_index=True, return_inverse=True)
        joined = number.ravel()[faces]
        a, b, c = joined.T
        joined = joined[(a != b) & (b != c) & (c != a)]
        _, kept = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
        if len(kept) <= most:
            return vertices[first].astype(np.float32), joined[np.sort(kept)].astype(np.int32)
        n_cells = math.floor(n_cells * 0.8)

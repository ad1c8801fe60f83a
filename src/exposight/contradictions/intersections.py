"""Where rays of a camera meet the light of a projector: whether most of them meet it at all.

A pixel that was lit sees a place before both lenses, within the projector's image. Where many rays
meet no such place, the calibration, the coordinates or the image are not what they are taken for;
usual mistakes are tried, and those with which all rays meet are the explanation.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

INTERSECTIONS = "intersections"

_Array = NDArray[np.float64]

_LEAST_PIXELS = 500
_MEET, _MEET_ERROR = 0.9, 0.8
"""Share of rays that meet the light. Right calibrations: 0.97 and more."""
_SPREAD, _USUAL_SPREAD = 10.0, 4.0
"""Ratio of depths, 95th to 5th percentile, above which a scene is odd, and below which usual."""
_FIT = 0.95


class Meeting(NamedTuple):
    """Rays, the projector coordinates that they see, and how both devices stand.

    Parameters
    ----------
    rays : (rows, columns, 2) ndarray
        X/Z and Y/Z along which pixels look, in the camera's frame.
    column, row : (rows, columns) ndarray, px, or None
        Projector coordinates; NaN where none was read. The lens's distortion is left out: it moves
        a place by some pixels, and here it is a matter of hundreds.
    rotation, translation_mm : (3, 3) and (3,) ndarray
        From the camera's frame to the projector's.
    matrix : (3, 3) ndarray, px
        Of the projector.
    size : (int, int), px
        Width and height of its image.
    """

    rays: _Array
    column: _Array | None
    row: _Array | None
    rotation: _Array
    translation_mm: _Array
    matrix: _Array
    size: tuple[int, int]


def check_intersections(meeting: Meeting) -> Contradiction | None:
    """Check that rays meet the light that they see.

    Parameters
    ----------
    meeting : Meeting
        Of an evenly spread sample of a camera's pixels.

    Returns
    -------
    Contradiction or None
        ``intersections``: an error where a fifth of the rays meets nothing.
    """
    depth = _depth(meeting)
    seen = _seen(meeting)
    if np.count_nonzero(seen) < _LEAST_PIXELS:
        return None
    share, spread = _quality(depth, seen)
    if share >= _MEET and spread <= _SPREAD:
        return None
    found = f"{100 * (1 - share):.0f} % of the pixels meet it nowhere before both lenses"
    if share >= _MEET:
        found = f"a twentieth of the points is {spread:.0f} times as far as the nearest twentieth"
    fitting = []
    for words, other in _readings(meeting):
        met, ratio = _quality(_depth(other), _seen(other))
        if met >= _FIT and ratio <= _USUAL_SPREAD:
            fitting.append(words)
    explanation = (
        f"all meet it with {'; or with '.join(fitting[:4])}"
        if fitting
        else "check that the calibration is of this camera and projector, at these resolutions, "
        "and that the images are as the camera took them"
    )
    return Contradiction(
        check=INTERSECTIONS,
        compared="rays of the camera's pixels, against the projector's light that they see",
        found=found,
        explanation=explanation,
        is_error=share < _MEET_ERROR,
    )


def _seen(meeting: Meeting) -> NDArray[np.bool_]:
    known = np.isfinite(meeting.rays[..., 0])
    for coordinate in (meeting.column, meeting.row):
        if coordinate is not None:
            known = known & np.isfinite(coordinate)
    return known


def _quality(depth: _Array, seen: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the share of seen pixels with a depth, and the ratio of far to near depths."""
    met = depth[seen]
    met = met[np.isfinite(met)]
    if met.size < 20:
        return 0.0, np.inf
    near, far = np.percentile(met, [5, 95])
    return met.size / max(1, np.count_nonzero(seen)), float(far / near)


def _depth(meeting: Meeting) -> _Array:
    """Return the depth at which each ray meets its light within the projector's image, or NaN."""
    rays = np.dstack([meeting.rays, np.ones(meeting.rays.shape[:2])])
    along = rays @ meeting.rotation.T
    start = meeting.translation_mm
    best = np.zeros(rays.shape[:2])
    depth = np.full(rays.shape[:2], np.nan)
    coordinates = (meeting.column, meeting.row)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, seen in enumerate(coordinates):
            if seen is None:
                continue
            normal = meeting.matrix[axis] - seen[..., None] * meeting.matrix[2]
            slope = np.einsum("rci,rci->rc", normal, along)
            better = np.abs(slope) > best  # the coordinate that moves more along the ray
            depth = np.where(better, -(normal @ start) / slope, depth)
            best = np.where(better, np.abs(slope), best)
        place = depth[..., None] * along + start
        image = place @ meeting.matrix.T
        good = (depth > 0) & (place[..., 2] > 0)
        for axis, length in enumerate(meeting.size):
            if coordinates[axis] is not None:
                continue  # coarse calibrations miss it by tens of px
            at = image[..., axis] / image[..., 2]
            good &= np.abs(at - 0.5 * (length - 1)) < 0.6 * length
    return np.asarray(np.where(good, depth, np.nan))


def _readings(meeting: Meeting) -> Iterator[tuple[str, Meeting]]:
    """Yield what else may be meant."""
    turned, moved = meeting.rotation.T, meeting.translation_mm
    yield "a translation of the opposite sign", meeting._replace(translation_mm=-moved)
    yield "the rotation transposed", meeting._replace(rotation=turned)
    yield (
        "rotation and translation inverted (they lead from the projector to the camera)",
        meeting._replace(rotation=turned, translation_mm=-turned @ moved),
    )
    for name, coordinate, size in (
        ("column", meeting.column, meeting.size[0]),
        ("row", meeting.row, meeting.size[1]),
    ):
        if coordinate is None:
            continue
        yield (
            f"the {name}s mirrored (mirrored = true), or all steps of their fringes reversed",
            _with(meeting, name, size - 1 - coordinate),
        )
        for quarter in (1, 2, 3):
            shifted = (coordinate + 0.25 * quarter * size) % size
            yield (
                f"the {name}s shifted by {quarter * size / 4:g} px of {size} (steps that begin "
                "elsewhere, such as a sine for a cosine, or another first_code)",
                _with(meeting, name, shifted),
            )
    for words, turn in (
        ("the image turned by 180°", (slice(None, None, -1), slice(None, None, -1))),
        ("the image mirrored left to right", (slice(None), slice(None, None, -1))),
        ("the image mirrored top to bottom", (slice(None, None, -1), slice(None))),
    ):
        yield (
            words,
            meeting._replace(
                column=None if meeting.column is None else meeting.column[turn],
                row=None if meeting.row is None else meeting.row[turn],
            ),
        )
    if meeting.column is not None and meeting.row is not None:
        yield "rows and columns exchanged", meeting._replace(column=meeting.row, row=meeting.column)


def _with(meeting: Meeting, name: str, coordinate: _Array) -> Meeting:
    """Return it with another column or row."""
    if name == "column":
        return meeting._replace(column=coordinate)
    return meeting._replace(row=coordinate)

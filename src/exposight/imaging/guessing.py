"""A pattern sequence from the frames alone: what they show, and how sure that is.

`exposight.imaging.frame_roles` tells white, black, steps and bits apart. Here the bits are ordered
and read in the way in which neighbours follow each other; fringes get their periods and direction
in `exposight.imaging.guessed_fringes`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.codes import (
    Reading,
    mean_jump,
    neighbouring_pairs,
    read_codes,
    share_near,
)
from exposight.errors import ImageError
from exposight.imaging.codings import GrayCode
from exposight.imaging.consistency import line_pairs
from exposight.imaging.frame_roles import FrameRoles, frame_roles
from exposight.imaging.frames import FrameStack
from exposight.imaging.guessed_fringes import (
    PlacedFringe,
    View,
    periods_in_view,
    phase_of,
    place_alone,
    place_by_code,
)
from exposight.imaging.sequences import AxisCoding, PatternSequence

_Array = NDArray[np.float64]

_LEAST_LIT = 500
_ASSUMED_SIZE = (1024, 768)

_LEAST_OF_BITS, _LEAST_OF_FRINGES = 0.75, 0.4
"""The least that is proposed. Most unrelated photographs stay below; recordings reach 0.88."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that the frames tell, or cannot.

    Parameters
    ----------
    what : str
        What it is about.
    found : str
        What is proposed.
    sure : float or None
        From 0 to 1: the share of pixels that agree, or by how far the runner-up lies behind; None
        for what the frames cannot tell.
    why : str
        What it rests on.
    """

    what: str
    found: str
    sure: float | None
    why: str


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A proposed sequence, and what each part of it rests on."""

    sequence: PatternSequence
    findings: tuple[Finding, ...]


class _Axis(NamedTuple):
    """What codes one projector axis: bits (with inverses) and fringes, by frame."""

    bits: list[int]
    inverses: list[int]
    fringes: list[tuple[int, ...]]


def guess_sequence(
    stack: FrameStack,
    *,
    projector_size: tuple[int, int] | None = None,
    file_pattern: str = "*.png",
) -> Guess:
    """Propose what the frames of a recording mean.

    Parameters
    ----------
    stack : FrameStack
        The recording.
    projector_size : (width, height), px, optional
        Without it the least is taken that the code covers, or 1024 × 768.
    file_pattern : str
        Which files the frames came from; it goes into the sequence.

    Returns
    -------
    Guess
        Its sequence has the stack's bit depth.

    Raises
    ------
    ImageError
        If the frames show no patterns, or none that can be told apart.
    """
    views = tuple(_view(stack, vertical=vertical) for vertical in (False, True))
    lit = np.concatenate([view.samples[:, view.lit] for view in views], axis=1)
    if lit.shape[1] < _LEAST_LIT or stack.n_frames < 3:
        msg = (
            f"no pattern can be told from {stack.n_frames} frames in which {lit.shape[1]} of the "
            "pixels looked at change: at least 3 frames and a lit part of the image are needed"
        )
        raise ImageError(msg)
    thin = lit[:, :: max(1, lit.shape[1] // 8_000)].astype(np.float32)
    roles = frame_roles(thin)
    findings = list(_role_findings(roles))
    codings: dict[str, AxisCoding] = {}
    sizes = dict(zip(("columns", "rows"), projector_size or (None, None), strict=True))
    for axis, view, content in zip(("columns", "rows"), views, _axes(roles, views), strict=True):
        if content.bits or content.fringes:
            size = sizes[axis] or _covered(content, axis)
            codings[axis], said = _coding(view, roles, content, axis, size)
            sizes[axis] = size
            findings += said
    if not codings:
        msg = "the frames change, but show neither steps of a fringe nor bits of a code"
        raise ImageError(msg)
    _refuse_unlikely(findings)
    width = sizes["columns"] or _ASSUMED_SIZE[0]
    height = sizes["rows"] or _ASSUMED_SIZE[1]
    findings += _unknowns(projector_size, width, height)
    sequence = PatternSequence(
        name="guessed from the frames",
        projector_width=width,
        projector_height=height,
        columns=codings.get("columns"),
        rows=codings.get("rows"),
        white_frame=roles.white,
        black_frame=roles.black,
        bit_depth=stack.bit_depth,
        saturation_level=stack.saturation_level,
        file_pattern=file_pattern,
        unused_frames=_unused(roles, stack.n_frames, codings),
    )
    return Guess(sequence=sequence, findings=tuple(findings))


def _refuse_unlikely(findings: Sequence[Finding]) -> None:
    """Raise an ImageError where bits or fringes agree no better than any photographs do."""
    for each in findings:
        least = {"bits": _LEAST_OF_BITS, "fringe": _LEAST_OF_FRINGES}.get(each.what.split()[0], 0)
        if each.sure is not None and each.sure < least:
            msg = (
                f"the frames change, but show no patterns: the likeliest {each.what} "
                f"({each.found}) agree to {100 * each.sure:.0f} %, {100 * least:.0f} % at least "
                "are expected; is it a folder of one recording, with all its frames?"
            )
            raise ImageError(msg)


def _view(stack: FrameStack, *, vertical: bool) -> View:
    light = line_pairs(stack, vertical=vertical, most=131_072)
    samples = light.frames.astype(np.float64)
    contrast = samples.max(axis=0) - samples.min(axis=0)
    least = max(10 / light.scale, 0.3 * float(np.percentile(contrast, 98)))
    return View(samples, contrast > least)


def _unused(roles: FrameRoles, n_frames: int, codings: dict[str, AxisCoding]) -> tuple[int, ...]:
    used = {frame for coding in codings.values() for frame in coding.frames}
    return tuple(sorted(set(range(n_frames)) - used - {roles.white, roles.black}))


def _role_findings(roles: FrameRoles) -> Iterator[Finding]:
    if roles.white is not None:
        yield Finding(
            what="white and black",
            found=f"frames {roles.white} and {roles.black}",
            sure=roles.agreement["white and black"],
            why="brightest and darkest of all frames in this share of the lit pixels",
        )
    if roles.inverses:
        yield Finding(
            what="inverse frames",
            found="each bit has one",
            sure=roles.agreement["inverses"],
            why="the two add up to white and black in this share of the lit pixels",
        )


# --- which axis ---------------------------------------------------------------------------------


def _axes(roles: FrameRoles, views: Sequence[View]) -> tuple[_Axis, _Axis]:
    """Share bits and fringes between columns (along the image's rows) and rows."""
    axes = _Axis([], [], []), _Axis([], [], [])
    for fringe in roles.fringes:
        across, down = (_change(view, fringe) for view in views)
        axes[0 if across >= down else 1].fringes.append(fringe)
    inverses = roles.inverses or (None,) * len(roles.bits)
    changes = np.array([[_flips(view, roles, i) for view in views] for i in range(len(roles.bits))])
    place = 0
    for i, (bit, inverse) in enumerate(zip(roles.bits, inverses, strict=True)):
        if changes[i].max() > 1.5 * changes[i].min():
            place = int(changes[i].argmax())
        elif i + 1 < len(roles.bits) and i == 0:  # no edge in view: with the next that has one
            place = int(changes[: len(changes)].sum(axis=0).argmax())
        axes[place].bits.append(bit)
        if inverse is not None:
            axes[place].inverses.append(inverse)
    return axes


def _change(view: View, fringe: Sequence[int]) -> float:
    """Return the periods of a fringe over the view."""
    return abs(periods_in_view(view, phase_of(view, fringe)))


def _signal(view: View, roles: FrameRoles, i: int) -> _Array:
    """Return lit minus unlit of the i-th bit."""
    lit = view.samples[roles.bits[i]]
    if roles.inverses:
        return np.asarray(lit - view.samples[roles.inverses[i]])
    return np.asarray(lit - _threshold(view, roles))


def _threshold(view: View, roles: FrameRoles) -> _Array:
    """Return the middle of white and black, of the fringes' steps, or of what is seen."""
    if roles.white is not None and roles.black is not None:
        return np.asarray(0.5 * (view.samples[roles.white] + view.samples[roles.black]))
    if roles.fringes:
        steps = [frame for fringe in roles.fringes for frame in fringe]
        return np.asarray(view.samples[steps].mean(axis=0))
    return np.asarray(0.5 * (view.samples.max(axis=0) + view.samples.min(axis=0)))


def _flips(view: View, roles: FrameRoles, i: int) -> float:
    """Return how often the i-th bit changes between neighbours that are lit and decided."""
    signal = _signal(view, roles, i)
    contrast = view.samples.max(axis=0) - view.samples.min(axis=0)
    sure = view.lit & (np.abs(signal) > 0.1 * contrast)
    both = sure[:, 1:] & sure[:, :-1]
    flips = np.sum(((signal[:, 1:] > 0) != (signal[:, :-1] > 0)) & both)
    return float(flips + 1e-9) / float(both.sum() + 1)


# --- bits ---------------------------------------------------------------------------------------


def _words(view: View, roles: FrameRoles, bits: Sequence[int]) -> NDArray[np.int64]:
    """Return the bits (by frame) of every pixel as a word, −1 where two are undecided."""
    contrast = view.samples.max(axis=0) - view.samples.min(axis=0)
    word = np.zeros(contrast.shape, dtype=np.int64)
    weak = np.zeros(contrast.shape, dtype=np.int64)
    for bit in bits:
        signal = _signal(view, roles, roles.bits.index(bit))
        word = 2 * word + (signal > 0)
        weak += np.abs(signal) < 0.02 * contrast
    return np.where(view.lit & (weak < 2), word, -1)


def _read(
    view: View, roles: FrameRoles, content: _Axis
) -> tuple[Reading, float, str, NDArray[np.int64]]:
    """Return the reading in which neighbours follow each other best, how sure, why, the codes."""
    words = _words(view, roles, content.bits)
    pairs = neighbouring_pairs(words)
    given = tuple(range(len(content.bits)))
    flips = [_flips(view, roles, roles.bits.index(bit)) for bit in content.bits]
    by_flips = tuple(sorted(given, key=lambda i: flips[i]))
    ways = [(False, False), (False, True), (True, False)]
    orders = dict.fromkeys((given, given[::-1], by_flips))
    if not pairs.size:
        msg = f"the bits of frames {content.bits} show no edge between lit pixels"
        raise ImageError(msg)
    jumps = {
        reading: mean_jump(pairs, reading)
        for reading in (Reading(order, *way) for order in orders for way in ways)
    }
    best, other = sorted(jumps, key=lambda reading: jumps[reading])[:2]
    near, less_near = (share_near(pairs, reading, jumps[best]) for reading in (best, other))
    why = (
        f"share of neighbours whose codes follow each other ({less_near:.2f} in the next best "
        f"reading); they differ by {2.0 ** jumps[best]:.1f} ({2.0 ** jumps[other]:.1f})"
    )
    return best, near, why, np.where(words >= 0, read_codes(words, best), -1)


def _covered(content: _Axis, axis: str) -> int:
    """Return the px that a code of one px covers, or what projectors often have."""
    if content.bits:
        return int(2 ** len(content.bits))
    return _ASSUMED_SIZE[axis == "rows"]


def _gray_code(content: _Axis, reading: Reading, size: int) -> GrayCode:
    frames, inverses = content.bits, content.inverses
    if inverses and reading.inverted:
        frames, inverses = inverses, frames
    n = len(reading.order)
    return GrayCode(
        frames=tuple(frames[i] for i in reading.order),
        inverse_frames=tuple(inverses[i] for i in reading.order) if inverses else (),
        code="binary" if reading.binary else "gray",
        code_width=max(1, math.ceil(size / 2**n)),
    )


def _coding(
    view: View, roles: FrameRoles, content: _Axis, axis: str, size: int
) -> tuple[AxisCoding, list[Finding]]:
    findings: list[Finding] = []
    gray_code: GrayCode | None = None
    coordinate: _Array | None = None
    if content.bits:
        reading, sure, why, codes = _read(view, roles, content)
        gray_code = _gray_code(content, reading, size)
        kind = "plain binary" if reading.binary else "Gray code"
        findings.append(
            Finding(
                what=f"bits of the {axis}",
                found=f"{kind}, coarse to fine: frames {', '.join(map(str, gray_code.frames))}",
                sure=sure,
                why=why,
            )
        )
        coordinate = _within_codes(codes, gray_code.code_width)
        findings.append(
            Finding(
                what=f"code of the {axis}",
                found=f"{gray_code.code_width} px wide, the first one 0",
                sure=None,
                why="the least width that covers the projector; frames do not tell",
            )
        )
    fringes = sorted(content.fringes, key=lambda fringe: _change(view, fringe))
    placed: list[PlacedFringe] = []
    if gray_code is not None and coordinate is not None:
        placed = place_by_code(view, fringes, coordinate, size, gray_code.code_width)
    elif fringes:
        placed = place_alone(view, fringes)
    for fringe, found in zip(fringes, placed, strict=True):
        findings.append(
            Finding(
                what=f"fringe of the {axis}",
                found=(
                    f"{found.fringe.periods:g} periods in {len(fringe)} steps: frames "
                    f"{', '.join(map(str, fringe))}"
                ),
                sure=found.sure,
                why=found.why,
            )
        )
    return AxisCoding(gray_code=gray_code, fringes=tuple(f.fringe for f in placed)), findings


def _within_codes(codes: NDArray[np.int64], width: int) -> _Array:
    """Return coordinates, px, that run from edge to edge of each run of a code along the lines."""
    coordinate = np.full(codes.shape, np.nan)
    for line, row in zip(codes, coordinate, strict=True):
        ends = np.flatnonzero(np.diff(line)) + 1
        bounds = [0, *ends.tolist(), line.size]
        for a, b, c, d in zip(bounds[:-3], bounds[1:-2], bounds[2:-1], bounds[3:], strict=True):
            before, here, after = int(line[a]), int(line[b]), int(line[d - 1])
            if here >= 0 and {before, after} == {here - 1, here + 1}:
                share = (np.arange(c - b) + 0.5) / (c - b)
                rising = share if after > before else 1.0 - share
                row[b:c] = (here + rising) * width - 0.5
    return coordinate


def _unknowns(projector_size: tuple[int, int] | None, width: int, height: int) -> Iterator[Finding]:
    if projector_size is None:
        yield Finding(
            what="projector's size",
            found=f"{width} × {height} px",
            sure=None,
            why="frames do not tell; give --projector-size or a calibration that has it",
        )
    yield Finding(
        what="mirrored or turned",
        found="not",
        sure=None,
        why="frames do not tell; points that lie behind or run backwards do",
    )

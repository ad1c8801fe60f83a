"""A pattern sequence from the frames alone: what they show, and how sure that is.

`exposight.imaging.frame_roles` tells white, black, steps and bits apart. Here the bits are ordered
and read in the way in which neighbours follow each other, and fringes get their number of periods
and their direction from the code, or from a fringe (or beat of two) that does not repeat in view.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
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
from exposight.contradictions.steps import Relation, best_relation, relation
from exposight.errors import ImageError
from exposight.imaging.codings import Fringe, GrayCode
from exposight.imaging.consistency import line_pairs
from exposight.imaging.frame_roles import FrameRoles, frame_roles
from exposight.imaging.frames import FrameStack
from exposight.imaging.sequences import AxisCoding, PatternSequence

_Array = NDArray[np.float64]

_LEAST_LIT = 500
_ASSUMED_SIZE = (1024, 768)


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


class _View(NamedTuple):
    """Samples of lit pixels along lines of one direction: (n, lines, length), and where lit."""

    samples: _Array
    lit: NDArray[np.bool_]


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


def _view(stack: FrameStack, *, vertical: bool) -> _View:
    light = line_pairs(stack, vertical=vertical, most=131_072)
    samples = light.frames.astype(np.float64)
    contrast = samples.max(axis=0) - samples.min(axis=0)
    least = max(10 / light.scale, 0.3 * float(np.percentile(contrast, 98)))
    return _View(samples, contrast > least)


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


def _axes(roles: FrameRoles, views: Sequence[_View]) -> tuple[_Axis, _Axis]:
    """Share bits and fringes between columns (along the image's rows) and rows."""
    axes = _Axis([], [], []), _Axis([], [], [])
    for fringe in roles.fringes:
        across, down = (_phase_change(view, fringe) for view in views)
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


def _phase(view: _View, fringe: Sequence[int]) -> _Array:
    """Return the phase of equal steps, in periods from 0 to 1."""
    turn = np.exp(2j * np.pi * np.arange(len(fringe)) / len(fringe))
    wave = np.tensordot(turn, view.samples[list(fringe)], axes=1)
    return np.asarray(np.angle(wave) / (2 * np.pi) % 1.0, dtype=np.float64)


def _phase_change(view: _View, fringe: Sequence[int]) -> float:
    wave = np.exp(2j * np.pi * _phase(view, fringe))
    both = view.lit[:, 1:] & view.lit[:, :-1]
    return float(np.median(np.abs(wave[:, 1:] - wave[:, :-1])[both])) if both.any() else 0.0


def _signal(view: _View, roles: FrameRoles, i: int) -> _Array:
    """Return lit minus unlit of the i-th bit."""
    lit = view.samples[roles.bits[i]]
    if roles.inverses:
        return np.asarray(lit - view.samples[roles.inverses[i]])
    return np.asarray(lit - _threshold(view, roles))


def _threshold(view: _View, roles: FrameRoles) -> _Array:
    """Return the middle of white and black, of the fringes' steps, or of what is seen."""
    if roles.white is not None and roles.black is not None:
        return np.asarray(0.5 * (view.samples[roles.white] + view.samples[roles.black]))
    if roles.fringes:
        steps = [frame for fringe in roles.fringes for frame in fringe]
        return np.asarray(view.samples[steps].mean(axis=0))
    return np.asarray(0.5 * (view.samples.max(axis=0) + view.samples.min(axis=0)))


def _flips(view: _View, roles: FrameRoles, i: int) -> float:
    """Return how often the i-th bit changes between neighbours that are lit and decided."""
    signal = _signal(view, roles, i)
    contrast = view.samples.max(axis=0) - view.samples.min(axis=0)
    sure = view.lit & (np.abs(signal) > 0.1 * contrast)
    both = sure[:, 1:] & sure[:, :-1]
    flips = np.sum(((signal[:, 1:] > 0) != (signal[:, :-1] > 0)) & both)
    return float(flips + 1e-9) / float(both.sum() + 1)


# --- bits ---------------------------------------------------------------------------------------


def _words(view: _View, roles: FrameRoles, bits: Sequence[int]) -> NDArray[np.int64]:
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
    view: _View, roles: FrameRoles, content: _Axis
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
    view: _View, roles: FrameRoles, content: _Axis, axis: str, size: int
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
    fringes = sorted(content.fringes, key=lambda fringe: _phase_change(view, fringe))
    width = None if gray_code is None else gray_code.code_width
    placed = _place(view, fringes, coordinate, size, width)
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


# --- fringes ------------------------------------------------------------------------------------


class _Placed(NamedTuple):
    fringe: Fringe
    sure: float | None
    why: str


def _place(
    view: _View,
    fringes: Sequence[tuple[int, ...]],
    coordinate: _Array | None,
    size: int,
    code_width: int | None,
) -> list[_Placed]:
    """Give fringes their periods and direction."""
    if not fringes:
        return []
    phases = [_phase(view, fringe) for fringe in fringes]
    why = "coherence with the code"
    if coordinate is None:
        coordinate, why = _absolute(view, phases, size)
    placed = []
    for fringe, phase in zip(fringes, phases, strict=True):
        usable = view.lit & np.isfinite(coordinate)
        at, here = coordinate[usable], phase[usable]
        exact = _periods(at, here, size, code_width)
        sign = math.copysign(1.0, exact.periods)
        offset_deg = 360.0 * _snapped(exact.offset, len(fringe))
        equal = [360.0 * k / len(fringe) for k in range(len(fringe))]
        shifts = tuple(_turned(sign * (shift - offset_deg)) for shift in equal)
        is_default = sign > 0 and not offset_deg
        placed.append(
            _Placed(
                Fringe(
                    periods=abs(exact.periods),
                    frames=fringe,
                    shifts_deg=() if is_default else shifts,
                ),
                exact.coherence,
                why + ("; it runs backwards" if sign < 0 else ""),
            )
        )
        if exact.coherence > 0.5 and exact.periods != 0:  # a finer coordinate for the next one
            order = np.rint(coordinate * (exact.periods / size) + exact.offset - phase)
            finer = (phase + order - exact.offset) * (size / exact.periods)
            coordinate = np.where(usable, finer, np.nan)
    return placed


def _turned(degrees: float) -> float:
    """Return an angle in whole degrees, from −180 to 179."""
    return float(round((degrees + 180.0) % 360.0 - 180.0)) + 0.0


def _snapped(offset: float, n: int) -> float:
    """Return an offset in periods: none, or whole steps (another frame comes first), if near."""
    whole = round(offset * n) / n
    return whole if abs(offset - whole) < 0.08 else offset


def _periods(at: _Array, phase: _Array, size: int, code_width: int | None) -> Relation:
    """Return a fringe's periods: a whole number, or simple in periods a code, where one fits."""
    found = best_relation(at, phase, size / 8, size)
    # A view of a part of the projector tells periods only so well.
    seen = float(np.ptp(np.percentile(at, [1, 99]))) / size
    blur = max(0.15, 0.15 / max(seen, 0.05))
    sign = math.copysign(1.0, found.periods)
    near = [
        each
        for each in range(math.ceil(abs(found.periods) - blur), int(abs(found.periods) + blur) + 1)
        if each >= 1
    ]
    simple = [float(each) for each in near]
    if code_width is not None:
        per_code = round(2 * abs(found.periods) * code_width / size) / 2
        in_px = per_code * size / code_width
        if per_code and abs(in_px - abs(found.periods)) < blur:
            simple.append(in_px)
    tried = [relation(at, phase, sign * each, size) for each in simple]
    # Nearly all fringes begin with a step at column 0: without an offset, a number fits better.
    good = [each for each in tried if each.coherence > 0.85 * found.coherence]
    if not good:
        return relation(at, phase, round(found.periods, 2), size)
    return max(good, key=lambda each: each.coherence * math.cos(2 * math.pi * each.offset))


def _absolute(view: _View, phases: Sequence[_Array], size: int) -> tuple[_Array, str]:
    """Return the coordinate of a fringe, or a beat of two, that does not repeat in view."""
    both = view.lit[:, 1:] & view.lit[:, :-1]

    def repeats(phase: _Array) -> float:
        return float(np.mean((np.abs(phase[:, 1:] - phase[:, :-1]) > 0.5)[both]))

    single = [(repeats(phase), phase, "a fringe that does not repeat in view") for phase in phases]
    beats = [
        (repeats((a - b) % 1.0), (a - b) % 1.0, "the beat of two fringes, taken as one period")
        for a, b in combinations(phases, 2)
    ]
    best = min([*single, *beats], key=lambda each: (each[0] > 0.002, each[0]))
    if best[0] > 0.002:
        msg = (
            "no fringe, and no beat of two, has one period in view, and no code tells periods "
            "apart: say in a sequence's file how many periods each fringe has"
        )
        raise ImageError(msg)
    phase = best[1]
    rise = np.diff(np.where(view.lit, phase, np.nan), axis=1)
    rise = rise[np.abs(rise) < 0.5]
    # Camera and projector look alike from left to right, unless one is turned round.
    if np.median(rise[rise != 0]) < 0:
        phase = (1.0 - phase) % 1.0
    return (
        phase * size,
        f"coherence with {best[2]}, which is taken to rise to the camera's right",
    )


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

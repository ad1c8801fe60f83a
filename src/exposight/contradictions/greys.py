"""Grey levels against the full scale and the single channel that they are said to have.

The checks look at a sample of an image or of a stack of frames: pairs of adjacent rows, evenly
spread, so that 2×2 neighbourhoods stay whole.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

# Of an image some 130 000 pixels are read, of a stack this many samples: a few milliseconds.
_SAMPLED_PIXELS, _SAMPLES = 131_072, 786_432

# A pile of clipped samples against the mean of the levels below it, at a level that less than 5 %
# of the pile's samples exceed.
_PILE = 10.0
_LEAST_PILE = 30

# Median difference of the four sites of 2×2 pixels from their mean. Cameras whose even and odd
# columns have own amplifiers differ by up to 1 %.
_MOSAIC_WARNING, _MOSAIC_ERROR = 0.03, 0.10

# A mosaic is the same all over the image, texture is not: standard deviations over eight parts.
_MOSAIC_PARTS, _MOSAIC_SURE = 8, 6.0


def check_greys(
    images: NDArray[Any],
    full_scale: int,
    *,
    clips_at: int | None = None,
    scaled: bool = False,
    what: str = "the frames",
) -> Iterator[Contradiction]:
    """Hold grey levels against their bit depth, and against what only a colour camera shows.

    Parameters
    ----------
    images : (rows, columns) or (n, rows, columns) ndarray of uint8 or uint16
        Grey levels of an image, or of several frames of one scene.
    full_scale : int
        The largest grey level of the bit depth.
    clips_at : int, optional
        Grey level from which on a sample counts as clipped, where that is another.
    scaled : bool
        True where the levels were scaled by calculation (an emulated exposure), so that they say
        nothing of the camera.
    what : str
        What the message calls them.

    Yields
    ------
    Contradiction
        ``saturation-spike``, ``grey-levels`` and ``mosaic``.
    """
    stack = images[None] if images.ndim == 2 else images
    sample = _row_pairs(stack)
    if not scaled:
        counts = np.bincount(sample.ravel(), minlength=full_scale + 1)
        spike = saturation_spike(counts, clips_at or full_scale, what)
        levels = level_spacing(counts, full_scale, what)
        yield from (each for each in (spike, levels) if each is not None)
        if spike is None and levels is None:
            quantised = _neighbour_noise(sample) < 8.0
            small = small_levels(counts, full_scale, what) if quantised else None
            yield from () if small is None else (small,)
    found = mosaic(sample, what)
    yield from () if found is None else (found,)


def _row_pairs(stack: NDArray[Any]) -> NDArray[Any]:
    """Return (n, 2·pairs, columns): pairs of adjacent rows, the first of each even."""
    n, rows, columns = stack.shape
    pairs = max(1, rows // 2)
    most = min(_SAMPLED_PIXELS, max(_SAMPLES // n, 16_384))
    step = max(1, math.ceil(pairs * 2 * columns / most))
    first = 2 * (np.arange(step // 2, pairs, step) if pairs > step // 2 else np.zeros(1, int))
    chosen = np.stack([first, np.minimum(first + 1, rows - 1)], axis=1).ravel()
    return np.asarray(stack[:, chosen])


def _neighbour_noise(sample: NDArray[Any]) -> float:
    """Median difference of neighbours along rows, in grey levels: noise and texture."""
    first = sample[0].astype(np.int32)
    return float(np.median(np.abs(np.diff(first, axis=1)))) if first.shape[1] > 1 else math.inf


def saturation_spike(
    counts: NDArray[np.int64], full_scale: int, what: str = "the frames"
) -> Contradiction | None:
    """Find a pile of samples at the highest level, below full scale: clipping that no flag tells.

    Parameters
    ----------
    counts : (levels,) ndarray of int
        How many samples have each grey level.
    full_scale : int
        Grey level at which a sample counts as clipped.
    what : str
        What the message calls the images.
    """
    level = _pile(counts)
    if level is None or level >= full_scale:
        return None
    bits = _depth_of(level)
    share = counts[level] / counts.sum()
    found = (
        f"{100 * share:.2g} % of their samples stand at level {level} and hardly any above, as if "
        f"clipped there, though full scale is {full_scale}"
    )
    if bits is not None:
        explanation = f"{level} is the full scale of {bits} bits: say a bit depth of {bits}"
    elif level in (_left_aligned(full_scale, bits) for bits in range(8, 16)):
        explanation = 'the levels stand in the high bits: say so (alignment = "high")'
    else:
        explanation = f"if the camera saturates at {level}, say so: saturation_level = {level}"
    return Contradiction(
        check="saturation-spike",
        compared=f"grey levels of {what} against full scale",
        found=found,
        explanation=explanation,
        is_error=not explanation.startswith("if"),
    )


def _pile(counts: NDArray[np.int64]) -> int | None:
    """Return the level at which samples pile up at the histogram's upper end."""
    above = counts[::-1].cumsum()[::-1] - counts
    candidates = np.flatnonzero((counts >= _LEAST_PILE) & (above <= 0.05 * counts))
    window = max(8, counts.size // 64)
    for level in candidates[::-1]:
        below = counts[max(0, level - window) : level]
        # Levels below are there, though fewer: a flat and noiseless surface has none near it.
        if (
            below.size >= 8
            and counts[level] > _PILE * below.mean()
            and np.count_nonzero(below) >= 8
            and below.sum() > 0.02 * counts[level]
        ):
            return int(level)
    return None


def _depth_of(level: int) -> int | None:
    bits = (level + 1).bit_length() - 1
    return bits if level + 1 == 1 << bits and bits >= 8 else None


def _left_aligned(full_scale: int, bits: int) -> int:
    """Return the highest level of `bits` bits that stand in the high bits of `full_scale`."""
    width = full_scale.bit_length()
    return ((1 << bits) - 1) << (width - bits) if bits < width else -1


def level_spacing(
    counts: NDArray[np.int64], full_scale: int, what: str = "the frames"
) -> Contradiction | None:
    """Find levels that stand apart evenly: fewer bits, scaled or shifted to another full scale.

    Parameters
    ----------
    counts : (levels,) ndarray of int
        How many samples have each grey level.
    full_scale : int
        Grey level at which a sample counts as clipped.
    what : str
        What the message calls the images.
    """
    levels = np.flatnonzero(counts)
    # With 20 samples a level, a level between two others is not left out by chance.
    if levels.size < 16 or counts.sum() < 20 * levels.size or np.diff(levels).min() < 2:
        return None
    scaled = _scaled_full_scale(levels)
    shift = int(np.bitwise_or.reduce(levels) & -np.bitwise_or.reduce(levels)).bit_length() - 1
    compared = f"spacing of the grey levels of {what} against full scale"
    if scaled is not None and shift == 0:
        bits, reached = scaled
        if reached == full_scale:
            return None
        return Contradiction(
            check="grey-levels",
            compared=compared,
            found=(
                f"they are those of {bits} bits scaled to a full scale of {reached}, though full "
                f"scale is said to be {full_scale}: brightness comes out "
                f"{full_scale / reached:.3g} times too low"
            ),
            explanation=f"say a bit depth of {reached.bit_length()}",
        )
    if shift >= 1:
        depth = full_scale.bit_length()
        reached = full_scale - (1 << shift) + 1
        piled = _pile(counts) == reached
        return Contradiction(
            check="grey-levels",
            compared=compared,
            found=(
                f"the {shift} lowest of {depth} bits are always 0, so no sample can reach full "
                f"scale {full_scale} and none counts as clipped"
            ),
            explanation=(
                f"the levels are those of {depth - shift} bits in the high ones of {depth}: say so "
                '(alignment = "high")'
            ),
            is_error=piled,
        )
    return None


def _scaled_full_scale(levels: NDArray[np.intp]) -> tuple[int, int] | None:
    """Return source bits and full scale of levels that are k·(2^b − 1)/(2^a − 1), rounded."""
    for bits in (8, 10, 12, 14):
        for wider in range(bits + 1, 17):
            reached = (1 << wider) - 1
            spacing = reached / ((1 << bits) - 1)
            if levels[-1] > reached or spacing < 2:
                continue
            k = np.rint(levels / spacing)
            if np.all(np.abs(levels - k * spacing) <= 0.5001):  # rounded to nearest
                return bits, reached
    return None


def small_levels(
    counts: NDArray[np.int64], full_scale: int, what: str = "the frames"
) -> Contradiction | None:
    """Find levels that all fit a bit depth 4 bits smaller or more: dark, or said too deep.

    Parameters
    ----------
    counts : (levels,) ndarray of int
        How many samples have each grey level.
    full_scale : int
        Grey level at which a sample counts as clipped.
    what : str
        What the message calls the images.
    """
    above = counts[::-1].cumsum()[::-1]
    highest = int(np.flatnonzero(above > 1e-5 * above[0])[-1])  # a hot pixel tells nothing
    bits = next(bits for bits in (8, 10, 12, 14, 16) if highest < 1 << bits)
    # Two bits fewer is an image that is four times too dark, as a sweep of exposures has.
    if full_scale < 16 * ((1 << bits) - 1) or highest <= 0.5 * ((1 << bits) >> 2):
        return None
    return Contradiction(
        check="grey-levels",
        compared=f"grey levels of {what} against full scale",
        found=f"none is above {highest} of {full_scale}",
        explanation=(
            f"either the exposure is {full_scale / max(highest, 1):.2g} times too short, or the "
            f"camera has {bits} bits: then say a bit depth of {bits}"
        ),
        is_error=False,
    )


def _steady(ratios: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sites' medians (4,) over their mean: dots on dark make all of them small."""
    medians = np.median(ratios, axis=1)
    return np.asarray(medians / medians.mean())


def mosaic(sample: NDArray[Any], what: str = "the frames") -> Contradiction | None:
    """Find a colour filter's 2×2 mosaic in a grey image.

    Parameters
    ----------
    sample : (n, rows, columns) ndarray
        Grey levels; row 2k and 2k + 1 are adjacent, and columns too.
    what : str
        What the message calls the images.
    """
    rows, columns = sample.shape[1] // 2 * 2, sample.shape[2] // 2 * 2
    if not rows or not columns:
        return None
    light = sample[:, :rows, :columns].astype(np.float32)
    light = light.mean(axis=0) if len(light) > 1 else light[0]
    sites = light.reshape(rows // 2, 2, columns // 2, 2).transpose(1, 3, 0, 2).reshape(4, -1)
    mean = sites.mean(axis=0)
    # Where light falls: an offset of the black level has no colour.
    lit = mean > max(0.5 * float(np.percentile(mean, 98)), 1.0)
    if np.count_nonzero(lit) < 200:
        return None
    ratios = sites[:, lit] / mean[lit]
    parts = np.array([_steady(part) for part in np.array_split(ratios, _MOSAIC_PARTS, axis=1)])
    ratio = parts.mean(axis=0)
    (r00, r01, r10, r11) = ratio.tolist()
    worst = float(np.abs(ratio - 1).max())
    noise = float(parts.std(axis=0).max()) / math.sqrt(_MOSAIC_PARTS - 1)
    if worst < max(_MOSAIC_WARNING, _MOSAIC_SURE * noise):
        return None
    main, other = abs(r00 - r11), abs(r01 - r10)
    if min(main, other) > 0.7 * max(main, other):
        return None  # no two sites alike on a diagonal, as green is: rows or columns differ
    pattern = "GRBG or GBRG" if main < other else "RGGB or BGGR"
    return Contradiction(
        check="mosaic",
        compared=f"pixels of even and odd rows and columns of {what}",
        found=(
            f"they differ steadily, by factors of {r00:.2f} {r01:.2f} / {r10:.2f} {r11:.2f} of "
            "their mean"
        ),
        explanation=(
            f"a colour camera's raw mosaic looks so ({pattern}): brightness becomes a matter of "
            "colour; let the camera give grey, or keep one channel"
        ),
        is_error=worst >= _MOSAIC_ERROR,
    )

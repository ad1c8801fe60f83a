"""A cloud against the camera whose pixels it has: its points lie where their pixels look.

Where they do not, the readings that users meet are tried: axes turned as viewers want them, rows or
columns reversed, an image without its lens distortion or rectified to another camera, cropped or
binned, or points in another frame. The one that fits is the explanation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import cv2
import numpy as np
from numpy.typing import NDArray

from exposight.contradictions.contradiction import Contradiction

OWN_PIXELS, BEHIND, THINNER = "own-pixels", "behind-camera", "thinner-than-image"

_MAY_BE_PX = 1.5
"""Decoded points stray by less than a pixel; a lens left out moves the image's rim by more."""
_CANNOT_BE_PX = 5.0
"""The ring of a small hole is so many pixels wide: its points would be looked for beside it."""
_FITS_PX = 0.75
"""A reading explains a cloud if its points then lie on their pixels, or nearly (`_FITS_SHARE`)."""
_FITS_SHARE = 0.1
_FEWEST_POINTS = 50


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A camera's matrix in px, image size, and whether it has distortion."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    is_distorted: bool


def own_pixels(
    points: NDArray[np.float64],
    pixels: NDArray[np.float64],
    rays: NDArray[np.float64],
    lens: Lens,
) -> Contradiction | None:
    """Check that points lie where their pixels look.

    Parameters
    ----------
    points : (n, 3) ndarray, mm
        Of an organised cloud, in the camera's frame.
    pixels : (n, 2) ndarray, px
        Column and row of each.
    rays : (n, 2) ndarray
        X/Z and Y/Z along which those pixels look, the lens's distortion undone.
    lens : Lens
        The camera.
    """
    known = np.isfinite(rays).all(axis=1) & np.isfinite(points).all(axis=1)
    points, pixels, rays = points[known], pixels[known], rays[known]
    if len(points) < _FEWEST_POINTS:
        return None
    off_px = _off_px(points, rays, lens)
    if off_px <= _MAY_BE_PX:
        return None
    behind = float(np.mean(points[:, 2] <= 0))
    found = (
        f"{100 * behind:.0f} % of its points lie behind the camera"
        if behind > 0.5
        else f"half of its points lie {_px(off_px)} px or more beside them"
    )
    fitting = _FITS_PX + _FITS_SHARE * min(off_px, 20.0)
    explanation = next(
        (words for words, left_px in _readings(points, pixels, rays, lens) if left_px <= fitting),
        "is it the calibration of the camera that took the image, at this resolution?",
    )
    return Contradiction(
        check=OWN_PIXELS,
        compared="where an organised cloud's points lie, against where their pixels look",
        found=found,
        explanation=explanation,
        is_error=off_px > _CANNOT_BE_PX,
    )


def behind_camera(points: NDArray[np.floating]) -> Contradiction | None:
    """Check that points (n, 3) of a cloud without rows and columns lie before the camera."""
    behind = points[:, 2][np.isfinite(points[:, 2])] <= 0
    share = float(behind.mean()) if behind.size else 0.0
    if share <= 0.5:
        return None
    return Contradiction(
        check=BEHIND,
        compared="a cloud against the camera that saw it",
        found=f"{100 * share:.0f} % of its points lie behind the camera (z ≤ 0)",
        explanation="are its axes turned? viewers' clouds have y up and z towards the viewer",
    )


def axes_named(turn: NDArray[np.float64]) -> str:
    """Return a signed permutation (3, 3) as the axes that it takes: ``x -y -z``."""
    names = []
    for row in turn:
        axis = int(np.argmax(np.abs(row)))
        names.append(("-" if row[axis] < 0 else "") + "xyz"[axis])
    return " ".join(names)


def axis_turns() -> list[NDArray[np.float64]]:
    """Return the 47 signed permutations of axes beside the identity, the usual ones first.

    First OpenGL's (x, −y, −z), then other changes of sign, then swapped axes.
    """
    turns = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[np.arange(3), order] = signs
        turns.append(turn)
    opengl = np.diag([1.0, -1.0, -1.0])

    def strangeness(turn: NDArray[np.float64]) -> tuple[bool, int, bool, int]:
        swapped = int(3 - np.abs(np.diag(turn)).sum())
        mirrored = bool(np.linalg.det(turn) < 0)
        return (not np.array_equal(turn, opengl), swapped, mirrored, int((turn < 0).sum()))

    return sorted((t for t in turns if not np.array_equal(t, np.eye(3))), key=strangeness)


def _off_px(points: NDArray[np.float64], rays: NDArray[np.float64], lens: Lens) -> float:
    """Return the median distance in px between points and the pixels that look along `rays`."""
    z = points[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.hypot(
            lens.fx * (points[:, 0] / z - rays[:, 0]), lens.fy * (points[:, 1] / z - rays[:, 1])
        )
    off[~(z > 0)] = np.inf
    return float(np.median(off))


def _readings(
    points: NDArray[np.float64],
    pixels: NDArray[np.float64],
    rays: NDArray[np.float64],
    lens: Lens,
) -> Iterator[tuple[str, float]]:
    """Yield what may have happened, the likeliest first, and by how many px the points then err."""
    size, centre = np.array([lens.width, lens.height]), np.array([lens.cx, lens.cy])
    focal = np.array([lens.fx, lens.fy])
    ideal = (pixels - centre) / focal
    for turn in axis_turns():
        named = axes_named(turn)
        why = " as viewers that use OpenGL want it" if named == "x -y -z" else ""
        yield (
            f"its axes are turned{why}: read them as {named} (--cloud-axes)",
            _off_px(points @ turn.T, rays, lens),
        )
    for which, flip in (
        ("columns", (True, False)),
        ("rows", (False, True)),
        ("rows and columns", (True, True)),
    ):
        turned = np.where(flip, size - 1 - pixels, pixels)
        yield (
            f"its {which} run the other way than the image's: turn image or cloud",
            _off_px(points, (turned - centre) / focal, lens),
        )
    if lens.is_distorted:
        yield (
            "the camera's matrix without its distortion fits: image and cloud are undistorted; "
            "give the camera without distortion",
            _off_px(points, ideal, lens),
        )
    before = points[:, 2] > 0
    if before.mean() > 0.5:
        yield _other_camera(points[before], pixels[before], lens)
    yield _other_frame(points, rays, lens)


def _other_camera(
    points: NDArray[np.float64], pixels: NDArray[np.float64], lens: Lens
) -> tuple[str, float]:
    """Fit a camera without distortion to the points and their pixels."""
    slopes = points[:, :2] / points[:, 2:]
    kept = np.ones(len(points), dtype=np.bool_)
    fits = np.zeros((2, 2))
    off = np.zeros(len(points))
    for _ in range(4):  # leaves out what lies off, such as points across an edge
        for axis in range(2):
            design = np.column_stack([slopes[kept, axis], np.ones(kept.sum())])
            fits[axis] = np.linalg.lstsq(design, pixels[kept, axis], rcond=None)[0]
        off = np.linalg.norm(slopes * fits[:, 0] + fits[:, 1] - pixels, axis=1)
        kept = off <= max(3.0 * float(np.median(off)), 1e-6)
    (fx, cx), (fy, cy) = fits.tolist()
    fitted = f"fx {fx:.1f}, fy {fy:.1f}, cx {cx:.1f}, cy {cy:.1f} px"
    return _what_camera(fx, fy, cx, cy, lens) + f" (it has {fitted})", float(np.median(off))


def _what_camera(fx: float, fy: float, cx: float, cy: float, lens: Lens) -> str:
    """Say how a camera may have come of another one."""
    ratios = np.array([fx / lens.fx, fy / lens.fy])
    if np.abs(ratios - 1.0).max() < 0.005 and not lens.is_distorted:
        left, top = lens.cx - cx, lens.cy - cy
        return (
            "the image is a region of the calibrated one, which begins at column "
            f"{left:.0f} and row {top:.0f}: shift the principal point by so much"
        )
    for times in (2, 3, 4):
        for ratio, words in ((1.0 / times, "binned or sub-sampled"), (float(times), "enlarged")):
            near = np.abs(ratios / ratio - 1.0).max() < 0.005
            middle = np.array([(lens.cx + 0.5) * ratio - 0.5, (lens.cy + 0.5) * ratio - 0.5])
            if near and np.abs(middle - (cx, cy)).max() < max(2.0, times):
                return (
                    f"the image is {words} {times} times against the calibration: give the camera "
                    "at the image's resolution"
                )
    return (
        "another camera without distortion fits: the image is rectified; give the camera of the "
        "rectified image (ROS: P instead of K and D)"
    )


def _other_frame(
    points: NDArray[np.float64], rays: NDArray[np.float64], lens: Lens
) -> tuple[str, float]:
    """Find the frame in which the points would lie on their pixels' rays."""
    chosen = np.linspace(0, len(points) - 1, min(len(points), 400)).astype(np.int64)
    try:
        found, turn, shift = cv2.solvePnP(
            np.ascontiguousarray(points[chosen]),
            np.ascontiguousarray(rays[chosen]),
            np.eye(3),
            None,
            flags=cv2.SOLVEPNP_SQPNP,
        )
    except cv2.error:
        return "", np.inf
    if not found:
        return "", np.inf
    rotation = cv2.Rodrigues(turn)[0]
    moved = points @ rotation.T + shift.ravel()
    place = ", ".join(f"{x:.1f}" for x in shift.ravel())
    angle_deg = np.degrees(np.linalg.norm(turn))
    return (
        f"the cloud is in another frame, whose origin lies at ({place}) mm in the camera's, turned "
        f"by {angle_deg:.1f}°: export it in the camera's frame",
        _off_px(moved, rays, lens),
    )


_BLOCK_PX = 8
_FEWEST_BLOCKS = 30
_THIN = 0.75
"""Of a block's pixels, at most, hold a point: where light suffices a cloud is denser somewhere."""
_EVEN = 2.0
"""The best blocks hold at most so many times the points of the median one: light and surfaces make
clouds less even than that, thinning does not."""
_COARSEST = 8
_GRID_SAMPLE, _STRIDES = 5_000, (11, 53, 211, 997)
_ON_GRID = 0.8
"""Length of the mean of exp(2πi·u/k) over points k pixels apart is 1, over others about 0."""
_DARK, _BRIGHT = 60.0, 200.0
"""Brightest grey levels of a pixel between which any surface gives points on most pixels."""


def thinner_than_image(
    pixels: NDArray[np.float64], grey: NDArray[np.floating]
) -> Contradiction | None:
    """Check that a cloud without rows and columns has as many points as the image has pixels.

    Points on every k-th pixel of rows and columns cannot be chance. A cloud that is evenly thin may
    be thinned, where its pixels are neither dark nor bright.

    Parameters
    ----------
    pixels : (n, 2) ndarray, px
        Where its points project to, those outside the image left out.
    grey : (n,) ndarray, 0–255
        The brightest that any frame has there.
    """
    if len(pixels) < _FEWEST_BLOCKS:
        return None
    low = np.floor(pixels.min(axis=0) / _BLOCK_PX)
    block = (np.floor(pixels / _BLOCK_PX) - low).astype(np.int64)
    counts = np.bincount(block[:, 1] * int(block[:, 0].max() + 1) + block[:, 0])
    shares = counts[counts > 0] / _BLOCK_PX**2
    coarser = coarser_than_image(pixels)
    if coarser is not None or shares.size < _FEWEST_BLOCKS:
        return coarser
    middle, high = (float(share) for share in np.percentile(shares, [50, 95]))
    lit = _DARK <= float(np.median(grey)) <= _BRIGHT
    thin = high <= _THIN and lit
    if high > _EVEN * middle or not (thin or middle >= 1.0 / _THIN):
        return None
    how = f"{1 / middle:.1f} times fewer" if thin else f"{middle:.1f} times more"
    return _of_another_density(
        f"{how} points than pixels, everywhere alike", middle, is_error=False
    )


def coarser_than_image(pixels: NDArray[np.float64]) -> Contradiction | None:
    """Check that points do not lie on every k-th pixel of rows and columns only.

    Parameters
    ----------
    pixels : (n, 2) ndarray, px
        Where points are, of rows and columns that share no divisor with k.
    """
    if len(pixels) < _FEWEST_POINTS:
        return None
    step = _step_of_grid(pixels)
    if step == 1:
        return None
    found = f"it has points on every {_ordinal(step)} pixel of rows and columns only"
    return _of_another_density(found, 1.0 / step**2, is_error=True)


def _of_another_density(found: str, times: float, *, is_error: bool) -> Contradiction:
    return Contradiction(
        check=THINNER,
        compared="how many points a cloud has where the image has pixels",
        found=found,
        explanation=(
            "the cloud is "
            + ("thinned" if times < 1 else "denser than the image, or several clouds in one file")
            + f", so every p_norm would be {times:.3g} times what it is: export the cloud "
            "organised, at its own resolution, with its missing points"
        ),
        is_error=is_error,
    )


def _step_of_grid(pixels: NDArray[np.float64]) -> int:
    """Return how many pixels the points lie apart, if on a grid coarser than the image; else 1."""
    # Strides that share no divisor with a step leave every residue in the sample.
    stride = max((each for each in _STRIDES if each * _GRID_SAMPLE <= len(pixels)), default=1)
    pixels = pixels[::stride]
    for step in range(_COARSEST, 1, -1):
        if np.abs(np.exp(2j * np.pi * pixels / step).mean(axis=0)).min() > _ON_GRID:
            return step
    return 1


def _ordinal(number: int) -> str:
    return {2: "second", 3: "third"}.get(number, f"{number}th")


def _px(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "infinitely many"

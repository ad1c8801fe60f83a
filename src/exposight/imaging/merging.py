"""Captures of one view at several exposure times merged into one (HDR), pixel by pixel.

After Zhang & Yau, *High dynamic range scanning technique*, Opt. Eng. 48(3), 033604, 2009: of the
exposures in which a pixel is not clipped, the one in which it is modulated most gives its point.
Nothing is averaged: each point, and each grey value, is one that a capture had.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from exposight.cell import Capture, Cloud, StackImages, png_bytes
from exposight.errors import CloudError, ImageError, InputError, PoseError
from exposight.files import DocumentFormat
from exposight.geometry import RigidTransform

Criterion = Literal["standard deviation", "modulation", "grey level"]
"""What says which exposure is best for a pixel: the least standard deviation of its point, the
greatest modulation, the greatest grey level of the image; all of pixels that do not clip."""

_SAME_MM, _SAME_DEG = 0.05, 0.005
"""By how much the poses of one view may differ: the part moves by a fifth of a pixel at most."""

_A_POINT = np.float32(1e6)
"""What a pixel with a point has before one without: more than any grey level."""

RECORD, TAKEN_FROM = "merged.json", "merged-from.png"
"""Attachments of a merged capture: what was merged how, and which exposure each pixel is from."""


@dataclass(frozen=True, kw_only=True)
class MergeRecord:
    """What was merged: the content of `RECORD`.

    Parameters
    ----------
    exposures_ms : tuple of float, ms
        Exposure times, ascending. Pixel values of `TAKEN_FROM` number them from 1; 0 is a pixel
        without a point.
    points : tuple of int
        Points taken from each.
    criterion : {"standard deviation", "modulation", "grey level"}
        What chose.
    """

    exposures_ms: tuple[float, ...]
    points: tuple[int, ...]
    criterion: Criterion

    def __post_init__(self) -> None:
        times, points = self.exposures_ms, self.points
        ascending = all(one < other for one, other in pairwise((0.0, *times)))
        if not times or not ascending or len(points) != len(times) or min(points) < 0:
            msg = (
                "a merged capture has ascending exposure times above 0 ms and a number of points "
                f"of each, got {times} and {points}"
            )
            raise InputError(msg)


_FORMAT = DocumentFormat("exposight merged capture", 1, MergeRecord)


def merge_captures(
    captures: Sequence[Capture],
    *,
    deviations_mm: Sequence[NDArray[np.floating[Any]]] | None = None,
) -> Capture:
    """Merge captures of one view.

    Parameters
    ----------
    captures : sequence of Capture
        At different exposure times, in any order, with organised clouds. They are looked up one at
        a time, so that a sequence may read them from disk.
    deviations_mm : sequence of (rows, columns) ndarray, mm, optional
        Standard deviation of each capture's points, where it is observed; NaN counts as unknown.

    Returns
    -------
    Capture
        ``brightness_source`` is "merged", ``exposure_ms`` the longest, and its attachments say from
        which exposure each pixel is (`merge_record`). Image and stack hold the grey values of the
        same exposures: no exposure time belongs to them. Other attachments are left out. A single
        capture is returned as it is.

    Raises
    ------
    InputError
        If there is no capture, they are of several views, or two have one exposure time.
    PoseError
        If the part stood elsewhere in one of them.
    ImageError, CloudError
        If images differ in size or bit depth, or a cloud is missing or not organised like its
        image.
    """
    if not captures:
        msg = "nothing to merge: give the captures of one view"
        raise InputError(msg)
    if len(captures) == 1:
        return captures[0]
    if deviations_mm is not None and len(deviations_mm) != len(captures):
        msg = (
            f"deviations_mm needs one array for each of {len(captures)} captures, got "
            f"{len(deviations_mm)}"
        )
        raise InputError(msg)
    order = _ascending(captures)
    criterion: Criterion = "grey level"
    if deviations_mm is not None:
        criterion = "standard deviation"
    elif all(capture.stack is not None for capture in captures):
        criterion = "modulation"
    first = captures[order[0]]
    merged = {name: layer.copy() for name, layer in _layers(first).items()}
    best = np.full(first.image.shape, -np.inf, dtype=np.float32)
    taken_from = np.ones(first.image.shape, dtype=np.uint8)
    limits = set()
    for number, i in enumerate(order, start=1):  # one in memory at a time, if they are on disk
        capture = captures[i]
        score = _score(capture, criterion, None if deviations_mm is None else deviations_mm[i])
        better = score > best
        best[better] = score[better]
        taken_from[better] = number
        layers = _layers(capture)
        merged = {name: merged[name] for name in merged if name in layers}
        for name, layer in merged.items():
            layer[better] = layers[name][better]
        limits.add(None if capture.stack is None else capture.stack.min_modulation)
    cloud = Cloud(points=merged.pop("points"), sigma_z_mm=merged.pop("sigma_z_mm", None))
    image = merged.pop("image")
    taken_from[~cloud.valid] = 0
    times_ms = tuple(captures[i].exposure_ms for i in order)
    record = MergeRecord(
        exposures_ms=times_ms,
        points=tuple(np.bincount(taken_from.ravel(), minlength=1 + len(order))[1:].tolist()),
        criterion=criterion,
    )
    stack = None
    if {"maximum", "modulation"} <= set(merged):
        limit = limits.pop() if len(limits) == 1 else None
        stack = StackImages(**merged, min_modulation=limit)
    return Capture(
        view=first.view,
        exposure_ms=times_ms[-1],
        image=image,
        cloud=cloud,
        camera_from_part=first.camera_from_part,
        bit_depth=first.bit_depth,
        emulated=any(capture.emulated for capture in captures),
        notes=f"merged of {', '.join(f'{time:g}' for time in times_ms)} ms by {criterion}",
        attachments={
            RECORD: _FORMAT.to_json(record).encode(),
            TAKEN_FROM: png_bytes(taken_from),
        },
        stack=stack,
        brightness_source="merged",
    )


def merge_record(capture: Capture) -> MergeRecord | None:
    """Return what a capture was merged of; None where it was taken as it is.

    Raises
    ------
    FormatError
        If its record is none.
    """
    if capture.brightness_source != "merged" or RECORD not in capture.attachments:
        return None
    return _FORMAT.from_bytes(capture.attachments[RECORD], f"{RECORD} of the {capture}")


def _score(
    capture: Capture, criterion: Criterion, deviation_mm: NDArray[np.floating[Any]] | None
) -> NDArray[np.float32]:
    """Return how good a capture is for each pixel, (rows, columns): with a point, not clipped."""
    stack = capture.stack
    brightest = capture.image if stack is None else stack.maximum
    if criterion == "standard deviation":
        known = np.asarray(deviation_mm, dtype=np.float32)
        if known.shape != capture.image.shape:
            msg = f"deviations_mm of the {capture} must be {capture.image.shape}, got {known.shape}"
            raise InputError(msg)
        with np.errstate(divide="ignore", invalid="ignore"):
            good = np.where(known > 0.0, np.minimum(1.0 / known, _A_POINT / 4), 0.0)
    elif criterion == "modulation" and stack is not None:
        good = stack.modulation
    else:
        good = capture.image
    score = np.where(brightest < capture.full_scale, good, -1.0).astype(np.float32)
    score[capture.require_cloud().valid] += _A_POINT
    return score


def _layers(capture: Capture) -> dict[str, NDArray[Any]]:
    """Return all that a capture has of each pixel."""
    stack = {} if capture.stack is None else capture.stack.images()
    cloud = capture.require_cloud()
    sigma = {} if cloud.sigma_z_mm is None else {"sigma_z_mm": cloud.sigma_z_mm}
    return {"points": cloud.points, **sigma, "image": capture.image, **stack}


def _ascending(captures: Sequence[Capture]) -> list[int]:
    """Return the places of captures by exposure time; check that they are of one view."""
    if len(captures) > np.iinfo(np.uint8).max:
        msg = f"at most {np.iinfo(np.uint8).max} captures can be merged, got {len(captures)}"
        raise InputError(msg)
    first, times_ms = captures[0], []
    for capture in captures:
        _check_alike(first, capture)
        times_ms.append(capture.exposure_ms)
    order = sorted(range(len(times_ms)), key=times_ms.__getitem__)
    for before, after in pairwise(order):
        if times_ms[before] == times_ms[after]:
            msg = f"two captures to merge are of {times_ms[after]:g} ms; leave one out"
            raise InputError(msg)
    return order


def _check_alike(first: Capture, capture: Capture) -> None:
    """Check that a capture can be of the same view of the same sensor as another."""
    if capture.view != first.view:
        msg = f"only captures of one view can be merged, got {first.view!r} and {capture.view!r}"
        raise InputError(msg)
    if capture.brightness_source == "merged":
        msg = f"the {capture} is merged already; merge the captures that it was made of"
        raise InputError(msg)
    pose, at = capture.camera_from_part, f"that at {first.exposure_ms:g} ms"
    moved_mm = pose.translation_mm - first.camera_from_part.translation_mm
    distance = float(np.linalg.norm(moved_mm))
    angle = _angle_deg(first.camera_from_part.inverse() @ pose)
    if distance > _SAME_MM or angle > _SAME_DEG:
        msg = (
            f"the {capture} stands {distance:.3g} mm and {angle:.2g}° from {at}; pixels of one "
            f"view see the same points only within {_SAME_MM:g} mm and {_SAME_DEG:g}°: give the "
            "moved one another view's name"
        )
        raise PoseError(msg)
    if (capture.image.shape, capture.bit_depth) != (first.image.shape, first.bit_depth):
        (rows, columns), (rows_there, columns_there) = capture.image.shape, first.image.shape
        msg = (
            f"the {capture} has {rows} × {columns} px of {capture.bit_depth} bits, {at} has "
            f"{rows_there} × {columns_there} px of {first.bit_depth} bits"
        )
        raise ImageError(msg)
    cloud = capture.require_cloud()
    if not cloud.organised or cloud.valid.shape != capture.image.shape:
        msg = (
            f"the cloud of the {capture} is not organised like its image, so its points belong to "
            "no pixel; export it with rows, columns and missing points, and simulate without "
            "--rings-only, which keeps the rings' points alone"
        )
        raise CloudError(msg)


def _angle_deg(turn: RigidTransform) -> float:
    axis = turn.rotation - turn.rotation.T
    sine = 0.5 * float(np.linalg.norm([axis[2, 1], axis[0, 2], axis[1, 0]]))
    return float(np.degrees(np.arctan2(sine, 0.5 * (np.trace(turn.rotation) - 1.0))))

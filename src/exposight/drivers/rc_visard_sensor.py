"""What an rc_visard says of its own cameras, against the sensor's file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from exposight.cell import ActiveSensor
from exposight.contradictions import Contradiction
from exposight.drivers.rc_visard_images import ImageSet
from exposight.geometry import PinholeCamera, RigidTransform

CALIBRATION = "rc-visard-calibration"

_SHARE = 0.002
"""By which focal lengths and baselines may differ: a depth of 500 mm changes by 1 mm."""

_PRINCIPAL_PX = 1.0
"""By which principal points may: conventions differ by half a pixel."""


def with_calibration(sensor: ActiveSensor, images: ImageSet) -> ActiveSensor:
    """Return a sensor with the cameras of a device: rectified, side by side.

    Parameters
    ----------
    sensor : ActiveSensor
        All else is kept: name, projector, TCP, exposure times.
    images : ImageSet
        Of the device.

    Raises
    ------
    SensorError, ContradictionError
        If it cannot be a sensor.
    """
    rows, columns = images.left.shape
    optics = images.optics
    camera = PinholeCamera(
        width=columns,
        height=rows,
        fx=optics.focal_px,
        fy=optics.focal_px,
        cx=optics.principal_px[0],
        cy=optics.principal_px[1],
    )
    right = RigidTransform(translation_mm=np.array([images.baseline_mm, 0.0, 0.0]))
    return replace(sensor, cameras=(camera, camera), first_from_camera=(RigidTransform(), right))


def calibration_contradiction(sensor: ActiveSensor, images: ImageSet) -> Contradiction | None:
    """Return where a sensor's file and the device itself differ, or None."""
    faults = list(_faults(sensor, with_calibration(sensor, images)))
    if not faults:
        return None
    return Contradiction(
        check=CALIBRATION,
        compared=f"sensor {sensor.name!r} of the cell's file, against what the device says",
        found="; ".join(faults),
        explanation="put the device's numbers into the sensor's file, and plan and train with it",
    )


def _faults(sensor: ActiveSensor, device: ActiveSensor) -> Iterator[str]:
    if len(sensor.cameras) != 2:
        yield f"{len(sensor.cameras)} cameras, not 2"
        return
    ours, theirs = sensor.camera, device.camera
    if (ours.width, ours.height) != (theirs.width, theirs.height):
        yield f"images of {ours.width} × {ours.height} px, not {theirs.width} × {theirs.height}"
    if not all(math.isclose(f, theirs.fx, rel_tol=_SHARE) for f in (ours.fx, ours.fy)):
        yield f"focal lengths {ours.fx:.2f} and {ours.fy:.2f} px, not {theirs.fx:.2f} px"
    if max(abs(ours.cx - theirs.cx), abs(ours.cy - theirs.cy)) > _PRINCIPAL_PX:
        yield (
            f"principal point ({ours.cx:.1f}, {ours.cy:.1f}) px, not "
            f"({theirs.cx:.1f}, {theirs.cy:.1f}) px"
        )
    if any(ours.distortion):
        yield "a lens that distorts, but the device sends rectified images"
    baselines = [each.first_from_camera[1].translation_mm for each in (sensor, device)]
    if np.linalg.norm(baselines[0] - baselines[1]) > _SHARE * baselines[1][0]:
        listed = ", ".join(f"{v:.2f}" for v in baselines[0])
        yield f"second camera at ({listed}) mm, not {baselines[1][0]:.2f} mm to the right"

"""The frames behind a cloud, as files that `exposight.imaging` and ``exposight decode`` read.

Every frame is a PNG image beside the capture's own. For structured light the campaign's folder
tells what they mean: ``sequence.toml``, and ``calibration.yml`` as OpenCV and SLStudio write it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from exposight.cell import png_bytes
from exposight.geometry import ProjectorCamera
from exposight.imaging import sequence_to_toml
from exposight.twin.sensors.patterns import projector_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy as np
    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor
    from exposight.imaging import DecodingLimits, PatternSequence

SEQUENCE_FILE, CALIBRATION_FILE = "sequence.toml", "calibration.yml"
FRAME_PATTERN = "frame-*.png"


def frame_files(frames: Iterable[NDArray[np.uint8]]) -> dict[str, bytes]:
    """Return frames, each (rows, columns), as names and contents of files, in their order."""
    return {f"frame-{i:02d}.png": png_bytes(frame) for i, frame in enumerate(frames)}


def meaning_of_frames(
    sensor: ActiveSensor, sequence: PatternSequence, limits: DecodingLimits
) -> dict[str, bytes]:
    """Return the files that say what a structured-light sensor's frames mean, by name.

    Parameters
    ----------
    sensor : ActiveSensor
        Whose frames they are, with a projector.
    sequence : PatternSequence
        What they show.
    limits : DecodingLimits
        With which the clouds were decoded.
    """
    header = (
        f"# The clouds were decoded with at least {limits.min_modulation:g} grey levels of "
        f"modulation and at most {limits.max_residual:g}\n"
        "# periods between coarse and fine phases.\n"
    )
    text = header + sequence_to_toml(replace(sequence, file_pattern=FRAME_PATTERN))
    projector = projector_of(sensor)
    rig = ProjectorCamera(
        camera=sensor.camera,
        projector=projector.camera,
        projector_from_camera=projector.camera_from_projector.inverse(),
    )
    return {SEQUENCE_FILE: text.encode(), CALIBRATION_FILE: rig.to_slstudio().encode()}

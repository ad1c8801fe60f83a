"""The frames behind a cloud, as files that `exposight.imaging` and ``exposight decode`` read.

Every frame is a PNG image beside the capture's own. For structured light the campaign's folder
tells what they mean: ``sequence.toml``, and ``calibration.yml`` as OpenCV and SLStudio write it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from exposight.cell import png_bytes
from exposight.files.durable import write_durably
from exposight.geometry import ProjectorCamera
from exposight.imaging import sequence_to_toml
from exposight.twin.sensors import LIMITS, STRIPES

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor

SEQUENCE_FILE, CALIBRATION_FILE = "sequence.toml", "calibration.yml"
FRAME_PATTERN = "frame-*.png"


def frame_files(frames: Iterable[NDArray[np.uint8]]) -> dict[str, bytes]:
    """Return frames, each (rows, columns), as names and contents of files, in their order."""
    return {f"frame-{i:02d}.png": png_bytes(frame) for i, frame in enumerate(frames)}


def keep_meaning(campaign: Path, sensor: ActiveSensor, *, wanted: bool) -> None:
    """Write what a structured-light sensor's frames mean into a campaign, or take it away.

    Parameters
    ----------
    campaign : Path
        The campaign's folder, without captures yet.
    sensor : ActiveSensor
        Whose frames they are; those of a stereo sensor need nothing but ``sensor.json``.
    wanted : bool
        Whether the campaign keeps raw frames.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    if wanted and sensor.projector is not None and len(sensor.cameras) == 1:
        projector = sensor.projector
        rig = ProjectorCamera.from_pose(
            sensor.camera, projector.camera, projector.camera_from_projector
        )
        write_durably(campaign / SEQUENCE_FILE, _sequence_toml().encode())
        write_durably(campaign / CALIBRATION_FILE, rig.to_slstudio().encode())
        return
    for name in (SEQUENCE_FILE, CALIBRATION_FILE):  # of an earlier run with another choice
        (campaign / name).unlink(missing_ok=True)


def _sequence_toml() -> str:
    header = (
        f"# The clouds were decoded with at least {LIMITS.min_modulation:g} grey levels of "
        f"modulation and at most {LIMITS.max_residual:g}\n"
        "# periods between coarse and fine phases.\n"
    )
    return header + sequence_to_toml(replace(STRIPES, file_pattern=FRAME_PATTERN))

"""The recording behind the demonstration: a skull, scanned by SLStudio's authors.

Two sequences of one static object by one camera and projector: a Gray code and a phase shift, with
the authors' own cloud of the former (Wilm et al., "SLStudio: open-source framework for real-time
structured light", IPTA 2014). Nothing of it is part of this project; it is read where it lies.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.io import loadmat

from exposight.cell import ActiveSensor, Cloud, ExposureRange, Projector
from exposight.errors import FormatError, MissingFileError
from exposight.geometry import ProjectorCamera, RigidTransform, read_projector_camera
from exposight.imaging import (
    DecodedMap,
    DecodingLimits,
    FrameStack,
    PatternSequence,
    decode,
    read_recording,
    sequence_preset,
    triangulate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

NOMINAL_EXPOSURE_MS = 10.0
"""What the recorded frames count as: their true exposure time was not handed down."""

DATA_VARIABLE = "EXPOSIGHT_REAL_DATA"
"""Environment variable that names the folder of recordings, in which ``skull`` lies."""

_DEFAULT_FOLDERS = (Path("../shared/data/real"), Path("data/real"))
_NEEDED = ("calibration.xml", "skull_gray", "skull_2x3")
_DEPTH_LIMITS_MM = (300.0, 2000.0)
"""Where a hand-held object before this rig can be; drops stray points of wrong unwrapping."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SkullRecording:
    """The skull's frames, calibration and reference.

    Parameters
    ----------
    folder : Path
        Where it was read.
    rig : ProjectorCamera
        Calibrated camera and projector.
    gray, phase : FrameStack
        The two sequences at the nominal exposure time.
    authors_points : (rows, columns, 3) ndarray of float64, mm
        The authors' own cloud; NaN where they have no point.
    """

    folder: Path
    rig: ProjectorCamera
    gray: FrameStack
    phase: FrameStack
    authors_points: NDArray[np.float64]


def find_skull(data: str | Path | None = None) -> Path:
    """Find the folder of the skull recording.

    Parameters
    ----------
    data : path, optional
        The folder itself, or the folder of recordings above it. Without it, the folder that the
        environment variable `DATA_VARIABLE` names is tried, then the usual places beside the
        project.

    Raises
    ------
    MissingFileError
        If it is nowhere; the message says what is needed.
    """
    candidates = _candidates(data)
    for folder in candidates:
        for place in (folder, folder / "skull"):
            if all((place / name).exists() for name in _NEEDED):
                return place
    msg = (
        f"no skull recording in {', '.join(map(str, candidates))}: expected a folder with "
        f"{', '.join(_NEEDED)} (the example data of SLStudio, frames as PNG). Give the folder "
        f"with --data, or set {DATA_VARIABLE} to the folder above it"
    )
    raise MissingFileError(msg)


def _candidates(data: str | Path | None) -> list[Path]:
    if data is not None:
        return [Path(data)]
    named = os.environ.get(DATA_VARIABLE)
    return [Path(named)] if named else list(_DEFAULT_FOLDERS)


def read_skull(folder: Path) -> SkullRecording:
    """Read both sequences, the calibration and the authors' cloud.

    Raises
    ------
    MissingFileError, FormatError, ImageError
        If a file is missing or not what it should be.
    """
    return SkullRecording(
        folder=folder,
        rig=read_projector_camera(folder / "calibration.xml"),
        gray=read_recording(
            folder / "skull_gray", sequence_preset("skull_gray"), exposure_ms=NOMINAL_EXPOSURE_MS
        ),
        phase=read_recording(
            folder / "skull_2x3", sequence_preset("skull_2x3"), exposure_ms=NOMINAL_EXPOSURE_MS
        ),
        authors_points=_read_authors_points(folder / "skull_gray" / "pointCloud.mat"),
    )


def _read_authors_points(path: Path) -> NDArray[np.float64]:
    if not path.is_file():
        msg = f"{path}: the authors' cloud is missing; copy the recording again"
        raise MissingFileError(msg)
    try:
        points = np.asarray(loadmat(path)["xyz"], dtype=np.float64)
    except (ValueError, KeyError, NotImplementedError, OSError, TypeError) as error:
        msg = f"{path}: expected a MATLAB file with an organised cloud 'xyz' ({error})"
        raise FormatError(msg) from error
    if points.ndim != 3 or points.shape[2] != 3:
        msg = f"{path}: 'xyz' must have shape (rows, columns, 3), got {points.shape}"
        raise FormatError(msg)
    return points


def decode_to_cloud(
    stack: FrameStack,
    sequence: PatternSequence,
    rig: ProjectorCamera,
    limits: DecodingLimits | None = None,
) -> tuple[DecodedMap, Cloud]:
    """Decode frames and triangulate them.

    Parameters
    ----------
    stack : FrameStack
        The frames.
    sequence : PatternSequence
        What they mean.
    rig : ProjectorCamera
        Who took and who showed them.
    limits : DecodingLimits, optional
        When a pixel counts as decoded.
    """
    decoded = decode(stack, sequence, limits or DecodingLimits())
    cloud = triangulate(
        decoded,
        camera=rig.camera,
        projector=rig.projector,
        projector_from_camera=rig.projector_from_camera,
        depth_limits_mm=_DEPTH_LIMITS_MM,
    )
    return decoded, cloud


def skull_sensor(rig: ProjectorCamera, cloud: Cloud) -> ActiveSensor:
    """Describe the rig as a sensor.

    Its working volume was not handed down, so the TCP is put on the optical axis at the object's
    median depth, rounded to 10 mm.

    Parameters
    ----------
    rig : ProjectorCamera
        Calibrated camera and projector.
    cloud : Cloud
        The decoded object.
    """
    depth = cloud.require_points()[:, 2]
    tcp_mm = float(round(float(np.median(depth)), -1))
    return ActiveSensor(
        name="SLStudio rig of the skull recording",
        cameras=(rig.camera,),
        first_from_camera=(RigidTransform(),),
        projector=Projector(camera=rig.projector, camera_from_projector=rig.camera_from_projector),
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, tcp_mm])),
        exposure=ExposureRange(min_ms=0.1, max_ms=1000.0, increment_ms=0.001),
        working_distance_mm=_DEPTH_LIMITS_MM,
    )

"""What several commands are given: a sensor, a pattern sequence, the part's pose."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import PRESETS, read_sensor, sensor_preset
from exposight.errors import (
    FileError,
    ImageError,
    MissingFileError,
    PoseError,
    SensorError,
    did_you_mean,
)
from exposight.geometry import RigidTransform
from exposight.imaging import SEQUENCE_PRESETS, read_sequence, sequence_preset

if TYPE_CHECKING:
    from collections.abc import Callable

    from exposight.cell import ActiveSensor
    from exposight.imaging import PatternSequence


def keep_inputs(output: Path, *inputs: Path | None) -> None:
    """Refuse to write to a file that is read.

    Raises
    ------
    FileError
        If the output is one of the inputs.
    """
    for path in inputs:
        if path is not None and output.exists() and path.exists() and output.samefile(path):
            msg = f"{output} is read by this command and would be replaced; give another --output"
            raise FileError(msg)


def make_folder(folder: Path, what: str) -> None:
    """Make the folder that something shall be written to.

    Raises
    ------
    FileError
        If it cannot be made; the message says what for.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        if folder.is_file():
            reason = "it is a file, and a folder is needed"
        msg = f"{folder} cannot be used for {what}: {reason}"
        raise FileError(msg) from error


def sensor_from(name_or_path: str) -> ActiveSensor:
    """Return the sensor that a preset's name or a JSON file describes.

    Raises
    ------
    SensorError
        If it is neither.
    FileError
        If the file is not a sensor's.
    """
    if name_or_path in PRESETS:
        return sensor_preset(name_or_path)
    path = Path(name_or_path)
    if path.is_file() or path.suffix.lower() == ".json":
        return read_sensor(path)
    msg = (
        f"no sensor '{name_or_path}': expected one of the presets {', '.join(PRESETS)}, or the "
        "JSON file of a sensor (every campaign folder has its own, sensor.json)"
        + did_you_mean(name_or_path, PRESETS)
    )
    raise SensorError(msg)


def sequence_from(name_or_path: str) -> PatternSequence:
    """Return the pattern sequence that a preset's name or a TOML file describes.

    Raises
    ------
    ImageError
        If it is neither.
    FileError
        If the file is not a sequence.
    """
    if name_or_path in SEQUENCE_PRESETS:
        return sequence_preset(name_or_path)
    path = Path(name_or_path)
    if path.is_file() or path.suffix.lower() == ".toml":
        return read_sequence(path)
    msg = (
        f"no pattern sequence '{name_or_path}': expected one of the presets "
        f"{', '.join(SEQUENCE_PRESETS)}, or a TOML file that says what each frame shows"
        + did_you_mean(name_or_path, SEQUENCE_PRESETS)
    )
    raise ImageError(msg)


POSE_CONVENTIONS: dict[str, tuple[str, Callable[[list[float]], RigidTransform]]] = {
    "fanuc": (
        "x,y,z,w,p,r in mm and degrees",
        lambda n: RigidTransform.from_fanuc_wpr(n[:3], n[3], n[4], n[5]),
    ),
    "kuka": (
        "x,y,z,A,B,C in mm and degrees",
        lambda n: RigidTransform.from_kuka_abc(n[:3], n[3], n[4], n[5]),
    ),
    "abb": (
        "x,y,z,q1,q2,q3,q4 in mm, scalar part first",
        lambda n: RigidTransform.from_abb_quaternion(n[:3], n[3:]),
    ),
    "ur": (
        "x,y,z,rx,ry,rz in m and rad",
        lambda n: RigidTransform.from_ur_rotation_vector(n[:3], n[3:]),
    ),
}
"""Robots' ways to write a pose: which numbers, and how they are read."""


def pose_from_text(convention: str, text: str) -> RigidTransform:
    """Read a pose as a robot writes it.

    Parameters
    ----------
    convention : str
        A key of `POSE_CONVENTIONS`.
    text : str
        Its numbers, with commas or blanks between them.

    Raises
    ------
    PoseError
        If there is no such convention, their count is another or one is no number.
    """
    if convention not in POSE_CONVENTIONS:
        *others, last = POSE_CONVENTIONS
        msg = f"poses are written as by {', '.join(others)} or {last}, got '{convention}'"
        msg += did_you_mean(convention, POSE_CONVENTIONS)
        raise PoseError(msg)
    expected, read = POSE_CONVENTIONS[convention]
    wanted = expected.split(" ", 1)[0].count(",") + 1
    numbers = _numbers(text)
    if numbers is None or len(numbers) != wanted:
        msg = f"a {convention} pose needs {wanted} numbers {expected}, got '{text}'"
        raise PoseError(msg)
    return read(numbers)


def pose_from_file(path: Path) -> RigidTransform:
    """Read a pose from a text file: 16 numbers, a 4×4 matrix row by row, translation in mm.

    Raises
    ------
    MissingFileError
        If it is not there.
    PoseError
        If it does not hold 16 numbers, or they are no pose.
    """
    if not path.is_file():
        msg = f"{path}: no such pose file; expected 16 numbers, a 4×4 matrix row by row, in mm"
        raise MissingFileError(msg)
    text = path.read_text(encoding="utf-8", errors="replace")
    numbers = _numbers(text)
    if numbers is None or len(numbers) != 16:
        got = "something else" if numbers is None else f"{len(numbers)} numbers"
        msg = f"{path}: a pose needs 16 numbers, a 4×4 matrix row by row, in mm; got {got}"
        raise PoseError(msg)
    try:
        return RigidTransform.from_matrix(np.reshape(numbers, (4, 4)))
    except PoseError as error:
        msg = f"{path}: {error}"
        raise PoseError(msg) from error


def _numbers(text: str) -> list[float] | None:
    """Return numbers between commas, semicolons, brackets or blanks; None if one is none."""
    try:
        return [float(word) for word in text.translate(str.maketrans("[],;", "    ")).split()]
    except ValueError:
        return None

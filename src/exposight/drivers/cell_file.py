"""A cell's file: which devices stand on the bench, and the commands that move and project."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from exposight.cell import ActiveSensor, Part, read_features, sensor_named_or_read
from exposight.drivers.commands import CellCommand
from exposight.drivers.genicam_camera import CameraSettings
from exposight.drivers.moves import MoveCommand
from exposight.drivers.rc_visard_rest import RcVisardSettings
from exposight.errors import InputError
from exposight.files import parse_toml, read_text, validate
from exposight.imaging import (
    DecodingLimits,
    PatternSequence,
    StereoLimits,
    sequence_named_or_read,
)


@dataclass(frozen=True, kw_only=True)
class ProjectorCommand(CellCommand):
    """A command that shows a pattern and ends when it is shown.

    Parameters
    ----------
    command, timeout_s
        As for `CellCommand`. ``{pattern}`` is the frame's number in the sequence, from 0.
    """

    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_placeholders(("pattern",), "[projector]", needed="pattern")

    def show(self, pattern: int) -> None:
        """Show a pattern.

        Raises
        ------
        SensorError
            As for `CellCommand.run`.
        """
        self.run(f"show pattern {pattern}", {"pattern": str(pattern)})


@dataclass(frozen=True, kw_only=True)
class SequenceChoice:
    """The patterns of a structured-light rig.

    Parameters
    ----------
    name : str
        A preset's name or the path of a sequence's TOML file.
    limits : DecodingLimits
        When a pixel counts as decoded.
    """

    name: str
    limits: DecodingLimits = field(default_factory=DecodingLimits)


@dataclass(frozen=True, kw_only=True)
class CellFile:
    """What a cell's file says; paths begin at its folder.

    Parameters
    ----------
    sensor : str
        A preset's name or a sensor's JSON file: its calibration and exposure times.
    part : str, optional
        Name of the part.
    features : str, optional
        List of the part's features.
    camera, second_camera : CameraSettings, optional
        The first camera, and the other one of a stereo head.
    projector : ProjectorCommand, optional
        What shows patterns.
    sequence : SequenceChoice, optional
        Which patterns.
    stereo : StereoLimits
        When a match counts.
    move : MoveCommand, optional
        What moves to a pose.
    rc_visard : RcVisardSettings, optional
        The rc_visard, in place of cameras.

    Raises
    ------
    InputError
        If they do not fit together.
    """

    sensor: str
    part: str = ""
    features: str | None = None
    camera: CameraSettings | None = None
    second_camera: CameraSettings | None = None
    projector: ProjectorCommand | None = None
    sequence: SequenceChoice | None = None
    stereo: StereoLimits = field(default_factory=StereoLimits)
    move: MoveCommand | None = None
    rc_visard: RcVisardSettings | None = None

    def __post_init__(self) -> None:
        if (self.projector is None) != (self.sequence is None):
            msg = "[projector] and [sequence] go together: a command that shows which patterns"
            raise InputError(msg)
        if self.rc_visard is not None and self.camera is not None:
            msg = "[rc_visard] stands in place of [camera]: leave out one of them"
            raise InputError(msg)
        if self.stereo != StereoLimits() and self.second_camera is None:
            msg = "[stereo] is of two cameras: give [second_camera], or leave it out"
            raise InputError(msg)
        if self.features is not None and not self.part.strip():
            msg = 'features need the name of their part: part = "door"'
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell's file with what it names.

    Parameters
    ----------
    file : CellFile
    sensor : ActiveSensor
    part : Part or None
        None where the file names no features.
    sequence : PatternSequence or None
    """

    file: CellFile
    sensor: ActiveSensor
    part: Part | None
    sequence: PatternSequence | None


def read_cell(path: str | Path) -> Cell:
    """Read a cell's file and the files that it names.

    Raises
    ------
    MissingFileError, FormatError
        If one is not there, or is wrong; keys are named as the file has them.
    SensorError, ImageError
        If sensor or sequence do not exist.
    """
    path = Path(path)
    what = "file of a cell in TOML"
    file = validate(CellFile, parse_toml(read_text(path, what), path, what), str(path))
    folder = path.parent
    sequence = None
    if file.sequence is not None:
        sequence = sequence_named_or_read(_beside(folder, file.sequence.name, ".toml"))
    part = None
    if file.features is not None:
        part = Part(name=file.part, features=read_features(folder / file.features))
    return Cell(
        file=file,
        sensor=sensor_named_or_read(_beside(folder, file.sensor, ".json")),
        part=part,
        sequence=sequence,
    )


def _beside(folder: Path, name: str, suffix: str) -> str:
    """Return the path of a file beside the cell's, or a preset's name as it is."""
    return str(folder / name) if name.lower().endswith(suffix) else name

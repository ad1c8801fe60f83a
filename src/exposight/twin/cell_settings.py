"""Settings of the simulated cell: what a plan's table ``[simulated]`` says."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from exposight.errors import InputError
from exposight.files import validate
from exposight.imaging import (
    PatternSequence,
    sequence_named_or_read,
    sequence_to_toml,
)
from exposight.twin.alignment import AlignmentErrors
from exposight.twin.light import Lighting
from exposight.twin.part import Finish

if TYPE_CHECKING:
    from exposight.plans import MeasuringPlan


@dataclass(frozen=True, kw_only=True)
class SimulatedCellSettings:
    """Everything about the simulated cell that sensor, part and plan do not say.

    Parameters
    ----------
    lighting : {'I', 'II', 'III'}
        Scenario of Sect. 4.1 of the paper: closed cell, its LED on, open cell.
    alignment : AlignmentErrors
        How wrong reported poses are.
    kinematic_share : mapping of str to float, 0 to 1
        Probability that a view is aligned by the robot's kinematics alone, by the name of its
        plane, of its random positions, or its own; 0 for all others.
    finish : {'bare', 'primer', 'paint', 'brushed'}, optional
        Finish of the whole part, in place of its mesh's own.
    sequence : PatternSequence, optional
        Patterns of a sensor with one camera.
    fringes : tuple of float
        In place of a sequence: periods of each fringe over the projector's columns, in four steps
        each. With neither, 1, 8 and 64.
    electrons_per_ms : float, optional
        Sensitivity of the cameras, e⁻/ms per 1/mm²; by default that of the paper's sensor of this
        kind (`CameraElectronics`).
    scene : Path, optional
        Folder of an exported scene (`exposight.twin.part.export_scene`); None for the door.
    rings_only : bool
        Trace and decode only the neighbourhoods of the features' rings: p_norm and i_avg are the
        same as from whole frames, images are black and clouds empty elsewhere. Not for stereo and
        Gray code, whose decoding weighs whole rows.
    raw_frames : bool
        Attach every frame that a cloud was computed from.

    Raises
    ------
    InputError
        If a value is unknown or impossible, or both sequence and fringes are given.
    """

    lighting: Lighting = "I"
    alignment: AlignmentErrors = field(default_factory=AlignmentErrors)
    kinematic_share: Mapping[str, float] = field(default_factory=dict, hash=False)
    finish: Finish | None = None
    sequence: PatternSequence | None = None
    fringes: tuple[float, ...] = ()
    electrons_per_ms: float | None = None
    scene: Path | None = None
    rings_only: bool = False
    raw_frames: bool = False

    def __post_init__(self) -> None:
        if self.scene is not None:  # worker processes may be elsewhere
            object.__setattr__(self, "scene", Path(self.scene).resolve())
        for key, value, known in (
            ("lighting", self.lighting, get_args(Lighting)),
            ("finish", self.finish, (None, *get_args(Finish))),
        ):
            if value not in known:
                names = ", ".join(filter(None, known))
                msg = f"simulated cell: {key} must be one of {names}, got {value!r}"
                raise InputError(msg)
        for name, share in self.kinematic_share.items():
            if not 0.0 <= share <= 1.0:
                msg = (
                    f"simulated cell: kinematic_share of {name!r} must be from 0 to 1, got {share}"
                )
                raise InputError(msg)
        if self.sequence is not None and self.fringes:
            msg = "simulated cell: sequence and fringes exclude each other; give one of them"
            raise InputError(msg)

    @classmethod
    def of_plan(cls, plan: MeasuringPlan, folder: Path | None = None) -> SimulatedCellSettings:
        """Return the settings that a plan carries; defaults for what it does not say.

        Parameters
        ----------
        plan : MeasuringPlan
            Its `simulated` is read.
        folder : Path, optional
            Where relative paths of a scene and a sequence begin: the plan's folder. The working
            directory by default.

        Raises
        ------
        FormatError
            If a key is unknown or a value impossible; the message names it.
        ImageError, FileError
            If there is no such sequence.
        """
        folder, source = folder or Path(), f"plan {plan.name!r}, [simulated]"
        table = dict(plan.simulated)
        name = table.pop("sequence", None) if isinstance(table.get("sequence"), str) else None
        settings = validate(cls, table, source)
        if settings.scene is not None:
            settings = replace(settings, scene=folder / str(table["scene"]))
        if name is not None:
            sequence = sequence_named_or_read(folder / name if name.endswith(".toml") else name)
            settings = replace(settings, sequence=sequence)
        return settings

    def table(self) -> dict[str, Any]:
        """Return the settings as a plan's file has them (`MeasuringPlan.simulated`)."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        table = {key: value for key, value in values.items() if value not in (None, ())}
        table["alignment"] = asdict(self.alignment)
        table["kinematic_share"] = dict(self.kinematic_share)
        if self.fringes:
            table["fringes"] = list(self.fringes)
        if self.sequence is not None:
            table["sequence"] = tomllib.loads(sequence_to_toml(self.sequence))
        if self.scene is not None:
            table["scene"] = str(self.scene)
        return table

"""Settings of the simulated cell: what a plan's table ``[simulated]`` says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from exposight import imaging
from exposight.errors import InputError
from exposight.files import validate
from exposight.geometry import RigidTransform
from exposight.plans import MeasuringPlan, view_seed
from exposight.twin.light import Lighting, ambient_share
from exposight.twin.part import Finishes, Surface, Zone

AlignedBy = Literal["photogrammetry", "kinematics"]

_ALIGNMENT = 0x414C49474E  # the purpose of a stream of random numbers


@dataclass(frozen=True, kw_only=True)
class AlignmentErrors:
    """Sizes of the alignment errors, of the part's pose in the TCP frame.

    Parameters
    ----------
    photogrammetric_mm, photogrammetric_deg : float, mm and degrees
        Root mean square length of the shift and of the turn, both normally distributed. Assumed: a
        fifth of a pixel on the surface, and a turn that moves points 0.3 m from the TCP by half as
        much; the paper calls this alignment accurate and gives no figure.
    kinematic_mm : (float, float, float), mm
        Shift of every view that is aligned by the robot's kinematics, along the TCP frame's axes: a
        robot's absolute error is systematic, its repeatability random. The paper notes errors up to
        5 mm (end of Sect. 3.2.2), and its near plane's quality never exceeds 0.9: a ring 3 to 5 mm
        outside the edge loses no point below 3 mm of sideways error, and 6 to 15 % at 4 to 5 mm. So
        4.5 mm; the direction was drawn once (184.3°, by numpy's ``default_rng(1)``).
    kinematic_max_mm, kinematic_max_deg : float, mm and degrees
        Largest random shift and turn of the kinematics beside that, in any direction; their sizes
        are uniformly distributed. Assumed: a robot's repeatability.

    Raises
    ------
    InputError
        If one of them is not a number, or a size is negative.
    """

    photogrammetric_mm: float = 0.05
    photogrammetric_deg: float = 0.005
    kinematic_mm: tuple[float, float, float] = (-4.488, -0.334, 0.0)
    kinematic_max_mm: float = 0.1
    kinematic_max_deg: float = 0.01

    def __post_init__(self) -> None:
        vector = tuple(map(float, self.kinematic_mm))
        if len(vector) != 3 or not all(map(math.isfinite, vector)):
            msg = f"alignment: kinematic_mm must be three numbers x, y, z, got {vector}"
            raise InputError(msg)
        object.__setattr__(self, "kinematic_mm", vector)
        for entry in fields(self):
            if entry.name == "kinematic_mm":
                continue
            value = float(getattr(self, entry.name))
            if not (math.isfinite(value) and value >= 0):
                msg = f"alignment: {entry.name} must be a number from 0 up, got {value}"
                raise InputError(msg)
            object.__setattr__(self, entry.name, value)


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """How one view was aligned, and how wrong that is.

    Parameters
    ----------
    aligned_by : {'photogrammetry', 'kinematics'}
        The method.
    reported_from_true : RigidTransform
        The error, in the TCP frame: ``reported_from_true @ tcp_from_part`` is what is recorded.
    """

    aligned_by: AlignedBy
    reported_from_true: RigidTransform

    @property
    def notes(self) -> str:
        """The alignment in words, for a capture's notes."""
        return (
            f"aligned by {self.aligned_by}, wrong by {self.error_mm:.3f} mm and "
            f"{self.error_deg:.4f}°"
        )

    @property
    def error_mm(self) -> float:
        """Shift at the TCP, mm."""
        return float(np.linalg.norm(self.reported_from_true.translation_mm))

    @property
    def error_deg(self) -> float:
        """Turn, degrees."""
        return math.degrees(Rotation.from_matrix(self.reported_from_true.rotation).magnitude())


def draw_alignment(
    errors: AlignmentErrors, kinematic_share: float, seed: int, view: str
) -> Alignment:
    """Draw how a view is aligned, and its error.

    Parameters
    ----------
    errors : AlignmentErrors
        How large the errors are.
    kinematic_share : float, 0 to 1
        Probability that the view is aligned by the robot's kinematics.
    seed : int, 0 or more
        The plan's seed.
    view : str
        The view's name.
    """
    generator = np.random.default_rng([*view_seed(seed, view), _ALIGNMENT])
    # All numbers are drawn in any case, so that another share changes only the views it has to.
    chance = generator.random()
    normal = generator.standard_normal((2, 3))
    size = generator.random(2)
    if chance >= kinematic_share:
        shift = normal[0] * errors.photogrammetric_mm / math.sqrt(3.0)
        turn_deg = normal[1] * errors.photogrammetric_deg / math.sqrt(3.0)
        return Alignment(
            aligned_by="photogrammetry", reported_from_true=_small_motion(shift, turn_deg)
        )
    direction = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    shift = np.array(errors.kinematic_mm) + direction[0] * size[0] * errors.kinematic_max_mm
    turn_deg = direction[1] * size[1] * errors.kinematic_max_deg
    return Alignment(aligned_by="kinematics", reported_from_true=_small_motion(shift, turn_deg))


def _small_motion(shift_mm: NDArray[np.float64], turn_deg: NDArray[np.float64]) -> RigidTransform:
    rotation = Rotation.from_rotvec(turn_deg, degrees=True)
    return RigidTransform(rotation=rotation.as_matrix(), translation_mm=shift_mm)


@dataclass(frozen=True, kw_only=True)
class SimulatedCellSettings:
    """Everything about the simulated cell that sensor, part and plan do not say.

    Parameters
    ----------
    lighting : {'I', 'II', 'III'} or float
        Light besides the projector's: a scenario of Sect. 4.1 of the paper (closed cell, its LED
        on, open cell), or ambient irradiance as a share of the fully lit projector's at the TCP.
    lamp : float, optional
        Power of the projector's lamp as a share of the nominal one, as of an aged or a new lamp.
    alignment : AlignmentErrors
        How wrong reported poses are.
    kinematic_share : mapping of str to float, 0 to 1
        Probability that a view is aligned by the robot's kinematics alone, by its name or that of
        the group in its plan (`PlannedView.group`); 0 for all others.
    finish : str, optional
        Finish of the whole part, in place of the scene's: `exposight.twin.part.FINISHES`, or one of
        the surfaces.
    surfaces : mapping of str to Surface
        Further finishes, or others in place of those with the same names.
    zones : tuple of Zone
        Where the part has another finish.
    sensor : mapping of str to object
        What is to be otherwise than in the sensor's own table (`SensorSettings`), key by key.
    scene : Path, optional
        A mesh, a folder or a scene's document (`exposight.twin.part.read_scene`); None for the
        door.
    rings_only : bool
        Trace and decode only the neighbourhoods of the features' rings: p_norm and i_avg are the
        same as from whole frames, images are black and clouds empty elsewhere. Not for stereo and
        Gray code, whose decoding weighs whole rows.
    raw_frames : bool
        Attach every frame that a cloud was computed from.

    Raises
    ------
    InputError
        If a value is unknown or impossible.
    """

    lighting: Lighting | float = "I"
    lamp: float | None = None
    alignment: AlignmentErrors = field(default_factory=AlignmentErrors)
    kinematic_share: Mapping[str, float] = field(default_factory=dict, hash=False)
    finish: str | None = None
    surfaces: Mapping[str, Surface] = field(default_factory=dict, hash=False)
    zones: tuple[Zone, ...] = ()
    sensor: Mapping[str, Any] = field(default_factory=dict, hash=False)
    scene: Path | None = None
    rings_only: bool = False
    raw_frames: bool = False

    def __post_init__(self) -> None:
        if self.scene is not None:  # worker processes may be elsewhere
            object.__setattr__(self, "scene", Path(self.scene).resolve())
        ambient_share(self.lighting)  # refuses others
        if self.lamp is not None and not 0.0 < self.lamp < math.inf:
            msg = f"simulated cell: lamp must be a share of its power above 0, got {self.lamp}"
            raise InputError(msg)
        if self.scene is None:  # else the scene may know more finishes
            self.finishes.check_names()
        for name, share in self.kinematic_share.items():
            if not 0.0 <= share <= 1.0:
                msg = (
                    f"simulated cell: kinematic_share of {name!r} must be from 0 to 1, got {share}"
                )
                raise InputError(msg)

    @property
    def finishes(self) -> Finishes:
        """What the part wears in place of the scene's own finishes."""
        return Finishes(finish=self.finish, surfaces=self.surfaces, zones=self.zones)

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
        return cls.of_table(plan.simulated, folder, f"plan {plan.name!r}, [simulated]")

    @classmethod
    def of_table(
        cls, values: Mapping[str, Any], folder: Path | None, source: str
    ) -> SimulatedCellSettings:
        """Return the settings in a table ``[simulated]``; as `of_plan`, `source` names it."""
        folder, table = folder or Path(), dict(values)
        _move_sensor_keys(table)
        settings = validate(cls, table, source)
        if settings.scene is not None:
            settings = replace(settings, scene=folder / str(table["scene"]))
        name = settings.sensor.get("sequence")
        if isinstance(name, str):
            sequence = imaging.sequence_named_or_read(
                folder / name if name.endswith(".toml") else name
            )
            settings = replace(settings, sensor={**settings.sensor, "sequence": asdict(sequence)})
        return settings

    def table(self) -> dict[str, Any]:
        """Return the settings as a plan's file has them (`MeasuringPlan.simulated`)."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        values |= {"surfaces": None, "zones": (), **self.finishes.table()}
        table = {key: value for key, value in values.items() if value not in (None, ())}
        table["alignment"] = _without_none(asdict(self.alignment))
        table["kinematic_share"] = dict(self.kinematic_share)
        table["sensor"] = _without_none(self.sensor)
        if self.scene is not None:
            table["scene"] = str(self.scene)
        return table


def _move_sensor_keys(table: dict[str, Any]) -> None:
    """Move what earlier versions said of the sensor beside it to where it stands now."""
    moved: dict[str, Any] = {key: table.pop(key) for key in ("sequence", "fringes") if key in table}
    if "electrons_per_ms" in table:
        moved["camera"] = {"electrons_per_ms": table.pop("electrons_per_ms")}
    if moved:
        table["sensor"] = {**moved, **table.get("sensor", {})}


def _without_none(value: Any) -> Any:
    """Return tables and lists without what TOML cannot say: entries that are None."""
    if isinstance(value, Mapping):
        return {key: _without_none(each) for key, each in value.items() if each is not None}
    return [_without_none(each) for each in value] if isinstance(value, list | tuple) else value

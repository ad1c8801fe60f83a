"""Measuring plans as people write them, in TOML or YAML (``docs/formats.md``).

In TOML; YAML has the same keys::

    format = "exposight measuring plan"
    version = 1
    name = "near and far"
    sensor = "comet-pro-ae"
    features = ["f1", "f2"]
    reference = "f1"

    [[planes]]
    name = "near"
    z_tcp_mm = -165
    x_mm = { first = -135, last = 135, count = 4 }    # or a list
    y_mm = [-100, 0, 100]
    exposures_ms = { first = 5, last = 100, count = 10 }    # logarithmic; or a list
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Discriminator, Field, Tag

from exposight.cell import sensor_preset
from exposight.errors import FormatError, InputError, MissingFileError
from exposight.files.documents import StrictDocument, check_header, validate
from exposight.files.durable import write_durably
from exposight.plans.alignment import AlignmentErrors
from exposight.plans.plain_yaml import load_yaml
from exposight.plans.plan import BlindViews, DepthPlane, MeasuringPlan, RandomPositions, Side
from exposight.plans.spacing import even_positions, logarithmic_exposures
from exposight.twin.light import Lighting

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.cell import ActiveSensor


PLAN_FORMAT = "exposight measuring plan"
PLAN_VERSION = 1
PLAN_SUFFIXES = (".toml", ".yaml", ".yml")

_LONGEST = 1000
"""Numbers in one list: more is a slip of the pen."""


class _Even(StrictDocument):
    first: float
    last: float
    count: Annotated[int, Field(ge=2, le=_LONGEST)]


class _Logarithmic(StrictDocument):
    first: Annotated[float, Field(gt=0)]
    last: Annotated[float, Field(gt=0)]
    count: Annotated[int, Field(ge=2, le=_LONGEST)]


def _written_as(value: object) -> str:
    return "steps" if isinstance(value, (dict, StrictDocument)) else "list"


_List = Annotated[tuple[float, ...], Tag("list")]
_Positions = Annotated[_List | Annotated[_Even, Tag("steps")], Discriminator(_written_as)]
_Exposures = Annotated[_List | Annotated[_Logarithmic, Tag("steps")], Discriminator(_written_as)]
_Range = Annotated[tuple[float, ...], Field(min_length=2, max_length=2)]


class _PlaneDocument(StrictDocument):
    name: str
    z_tcp_mm: float
    x_mm: _Positions
    y_mm: _Positions
    exposures_ms: _Exposures
    kinematic_share: float = 0.0

    def build(self, sensor: ActiveSensor) -> DepthPlane:
        return DepthPlane(
            name=self.name,
            z_tcp_mm=self.z_tcp_mm,
            x_mm=_positions(self.x_mm),
            y_mm=_positions(self.y_mm),
            exposures_ms=_exposures(self.exposures_ms, sensor, self.name),
            kinematic_share=self.kinematic_share,
        )


class _RandomDocument(StrictDocument):
    name: str
    count: int
    x_mm: _Range
    y_mm: _Range
    z_tcp_mm: _Range
    exposures_ms: _Exposures
    kinematic_share: float = 0.0

    def build(self, sensor: ActiveSensor) -> RandomPositions:
        return RandomPositions(
            name=self.name,
            count=self.count,
            x_mm=(self.x_mm[0], self.x_mm[1]),
            y_mm=(self.y_mm[0], self.y_mm[1]),
            z_tcp_mm=(self.z_tcp_mm[0], self.z_tcp_mm[1]),
            exposures_ms=_exposures(self.exposures_ms, sensor, self.name),
            kinematic_share=self.kinematic_share,
        )


class _AlignmentDocument(StrictDocument):
    photogrammetric_mm: float = AlignmentErrors.photogrammetric_mm
    photogrammetric_deg: float = AlignmentErrors.photogrammetric_deg
    kinematic_max_mm: float = AlignmentErrors.kinematic_max_mm
    kinematic_max_deg: float = AlignmentErrors.kinematic_max_deg


class _PlanDocument(StrictDocument):
    format: Literal["exposight measuring plan"]
    version: int
    name: str
    sensor: str
    features: tuple[str, ...]
    reference: str
    side: Side = "inside"
    lighting: Lighting = "I"
    blind_views: BlindViews = "refuse"
    seed: int = 0
    alignment: _AlignmentDocument = _AlignmentDocument()
    planes: tuple[_PlaneDocument, ...] = ()
    random: tuple[_RandomDocument, ...] = ()

    def build(self) -> MeasuringPlan:
        sensor = sensor_preset(self.sensor)
        return MeasuringPlan(
            name=self.name,
            sensor=self.sensor,
            features=self.features,
            reference=self.reference,
            side=self.side,
            planes=tuple(plane.build(sensor) for plane in self.planes),
            random=tuple(box.build(sensor) for box in self.random),
            lighting=self.lighting,
            blind_views=self.blind_views,
            alignment=AlignmentErrors(**self.alignment.model_dump()),
            seed=self.seed,
        )


def _positions(written: tuple[float, ...] | _Even) -> tuple[float, ...]:
    if isinstance(written, _Even):
        return even_positions(written.first, written.last, written.count)
    return written


def _exposures(
    written: tuple[float, ...] | _Logarithmic, sensor: ActiveSensor, views: str
) -> tuple[float, ...]:
    if not isinstance(written, _Logarithmic):
        return written
    try:
        return logarithmic_exposures(written.first, written.last, written.count, sensor)
    except InputError as error:
        msg = f"exposures_ms of {views!r}: {error}"
        raise InputError(msg) from error


def read_plan(path: str | Path) -> MeasuringPlan:
    """Read a measuring plan from a TOML or YAML file, told by its suffix.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is neither TOML nor YAML or not a plan, a key is unknown, missing or there twice, or
        a value is impossible.
    VersionError
        If it was written for a newer version of exposight.
    """
    path = Path(path)
    if not path.is_file():
        msg = f"{path}: no such measuring plan; expected a TOML or YAML file"
        raise MissingFileError(msg)
    suffix = path.suffix.lower()
    if suffix not in PLAN_SUFFIXES:
        msg = f"{path}: a measuring plan ends in {', '.join(PLAN_SUFFIXES)}, got {path.suffix!r}"
        raise FormatError(msg)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        msg = f"{path} is not UTF-8 text; expected a measuring plan in TOML or YAML"
        raise FormatError(msg) from error
    from_text = plan_from_toml if suffix == ".toml" else plan_from_yaml
    return from_text(text, source=str(path))


def plan_from_toml(text: str, *, source: str = "the measuring plan") -> MeasuringPlan:
    """Read a measuring plan from TOML.

    Parameters
    ----------
    text : str
        The plan.
    source : str
        Where it comes from, for messages.

    Raises
    ------
    FormatError, VersionError
        As for `read_plan`.
    """
    try:
        raw: object = tomllib.loads(text)
    except RecursionError as error:
        msg = f"{source} is not TOML: it is nested too deeply"
        raise FormatError(msg) from error
    except ValueError as error:  # broken, or a number of thousands of digits
        msg = f"{source} is not TOML: {error}"
        raise FormatError(msg) from error
    return _plan(raw, source)


def plan_from_yaml(text: str, *, source: str = "the measuring plan") -> MeasuringPlan:
    """Read a measuring plan from YAML (`exposight.plans.plain_yaml`), with the keys of TOML.

    Parameters
    ----------
    text : str
        The plan.
    source : str
        Where it comes from, for messages.

    Raises
    ------
    FormatError, VersionError
        As for `read_plan`.
    """
    try:
        raw = load_yaml(text)
    except ValueError as error:
        msg = f"{source} is not the plain YAML of a plan: {error}"
        raise FormatError(msg) from error
    return _plan(raw, source)


def _plan(raw: object, source: str) -> MeasuringPlan:
    if not isinstance(raw, dict):
        msg = f"{source} must hold keys and values, got {type(raw).__name__}"
        raise FormatError(msg)
    check_header(raw, format_name=PLAN_FORMAT, newest=PLAN_VERSION, source=source)
    document = validate(_PlanDocument, raw, source)
    try:
        return document.build()
    except InputError as error:
        msg = f"{source}: {error}"
        raise FormatError(msg) from error


def write_plan(path: str | Path, plan: MeasuringPlan) -> None:
    """Write a measuring plan as a TOML file; the file is whole or absent.

    Raises
    ------
    FormatError
        If the file's name does not end in .toml.
    FileError
        If the disk refuses.
    """
    if Path(path).suffix.lower() != ".toml":
        msg = f"{path}: plans are written in TOML; give the file a name that ends in .toml"
        raise FormatError(msg)
    write_durably(Path(path), plan_to_toml(plan).encode())


def plan_to_toml(plan: MeasuringPlan) -> str:
    """Return a measuring plan in TOML, every key written out, to be read or edited."""
    lines = [
        *_entries(format=PLAN_FORMAT, version=PLAN_VERSION, name=plan.name, sensor=plan.sensor),
        *_entries(features=plan.features, reference=plan.reference, side=plan.side),
        *_entries(lighting=plan.lighting, blind_views=plan.blind_views, seed=plan.seed),
        "",
        "[alignment]",
        *_entries(**vars(plan.alignment)),
    ]
    for plane in plan.planes:
        lines += ["", "[[planes]]", *_entries(**vars(plane))]
    for box in plan.random:
        lines += ["", "[[random]]", *_entries(**vars(box))]
    return "\n".join(lines) + "\n"


_TomlValue = str | int | float | tuple[str, ...] | tuple[float, ...]


def _entries(**values: _TomlValue) -> Iterator[str]:
    for key, value in values.items():
        yield f"{key} = {_toml(value)}"


def _toml(value: _TomlValue) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # TOML's basic strings are JSON's
    return repr(value).removesuffix(".0")

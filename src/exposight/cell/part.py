"""Features, the region of the surface that each kind is measured by, and the part that has them.

To add a kind of feature, write a `KindRule` that checks a feature's sizes and gives its region as a
hollow cylinder in the feature's frame, add it to `RULES`, and its name to `FeatureKind`. Files,
masks, observations and models then handle it without further changes.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal

from exposight.errors import FeatureError
from exposight.files import check_plain
from exposight.geometry import HollowCylinder, RigidTransform, StackedPoses

FeatureKind = Literal["hole", "slot", "pocket", "sphere", "surface_point"]

_FURTHEST_MM = 1e6
"""Coordinates and sizes reach so far, as those of observations do."""

SPHERE_CAP_DEG = 45.0
"""Half angle of the cap that a sphere is measured by.

A convention of this library: beyond it the surface turns too far away from a sensor that faces the
feature.
"""


@dataclass(frozen=True, kw_only=True)
class RingTolerance:
    """How far the measured region reaches beyond a feature (Sects. 3.1.1 and 3.1.3 of the paper).

    Parameters
    ----------
    height_mm : float, mm
        h of the hollow cylinder: how thick a slice of space counts as the surface.
    inner_mm : float, mm
        r_tol,i: the ring begins this far outside the feature's edge.
    outer_mm : float, mm
        r_tol,o: the ring ends this far outside the feature's edge.

    Raises
    ------
    FeatureError
        If the height is not positive or not 0 ≤ inner < outer.
    """

    height_mm: float = 20.0
    inner_mm: float = 3.0
    outer_mm: float = 5.0

    def __post_init__(self) -> None:
        if not (0 < self.height_mm < math.inf and 0 <= self.inner_mm < self.outer_mm < math.inf):
            msg = (
                "a ring's tolerance needs a height above 0 and 0 ≤ inner < outer in mm, got "
                f"height {self.height_mm:g}, inner {self.inner_mm:g}, outer {self.outer_mm:g}"
            )
            raise FeatureError(msg)


PAPER_TOLERANCE = RingTolerance()
"""h = 20 mm, r_tol,i = 3 mm, r_tol,o = 5 mm (Sect. 3.1.3 of the paper)."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """A place on a part that shall be measured.

    Parameters
    ----------
    name : str
        Unique on its part.
    kind : {'hole', 'slot', 'pocket', 'sphere', 'surface_point'}
        What it is; the sizes of each kind are explained in ``docs/formats.md``.
    part_from_feature : RigidTransform
        Where it is on the part: origin at its centre on the surface (of a sphere: at its centre),
        z along the surface normal into the material, x along the length of a slot or pocket.
    radius_mm : float, mm
        Radius of a hole or sphere, of a slot's ends, of a pocket's corners, of the disc about a
        surface point.
    length_mm, width_mm : float, mm, optional
        Overall length along x and width along y; slots and pockets only.
    finish : str
        Name of the surface that it is on, such as "primer"; empty where it is not known.

    Raises
    ------
    FeatureError
        If the kind is unknown, a size is missing, not finite or not positive, the sizes contradict
        each other, or a coordinate or size is beyond a kilometre. The message names the feature.
    """

    name: str
    kind: FeatureKind
    part_from_feature: RigidTransform
    radius_mm: float
    length_mm: float | None = None
    width_mm: float | None = None
    finish: str = ""

    def __post_init__(self) -> None:
        check_plain(self.name, "the feature", FeatureError)
        check_plain(self.finish, f"feature {self.name!r}: its finish", FeatureError)
        if not self.name.strip() or self.name != self.name.strip():
            msg = f"a feature needs a name without blanks at its ends, got {self.name!r}"
            raise FeatureError(msg)
        if self.finish != self.finish.strip():
            msg = (
                f"feature {self.name!r}: its finish must be a name without blanks at its "
                f"ends, or empty, got {self.finish!r}"
            )
            raise FeatureError(msg)
        fault = self._fault()
        if fault:
            msg = f"feature {self.name!r}: {fault}"
            raise FeatureError(msg)

    def _fault(self) -> str:
        rule = RULES.get(self.kind)
        if rule is None:
            return f"its kind must be one of {', '.join(RULES)}, got {self.kind!r}"
        smallest = rule.smallest_radius_mm
        if not math.isfinite(self.radius_mm):
            return f"its radius_mm must be a number, got {self.radius_mm}"
        if smallest is None and self.radius_mm <= 0:
            return f"the radius of a {self.kind} must be above 0 mm, got {self.radius_mm:g}"
        if smallest is not None and self.radius_mm < smallest:
            return (
                f"the radius of a {self.kind} must be at least {smallest:g} mm, got "
                f"{self.radius_mm:g}"
            )
        for column, value in (("length_mm", self.length_mm), ("width_mm", self.width_mm)):
            if not rule.has_length and value is not None:
                return f"a {self.kind} has no {column}, got {value:g}; leave it empty"
            if rule.has_length and (value is None or not math.isfinite(value) or value <= 0):
                return f"a {self.kind} needs a {column} above 0 mm, got {value}"
        place = map(abs, self.part_from_feature.translation_mm)
        furthest = max(*place, self.radius_mm, self.length_mm or 0.0, self.width_mm or 0.0)
        if furthest > _FURTHEST_MM:
            return (
                f"its place and sizes must lie within {_FURTHEST_MM:g} mm, a kilometre, got "
                f"{furthest:g}; is its unit mm?"
            )
        return rule.fault(self)

    def measured_region(self, tolerance: RingTolerance = PAPER_TOLERANCE) -> HollowCylinder:
        """Return the region whose points and pixels are counted, in the feature's frame (Eq. 4).

        Parameters
        ----------
        tolerance : RingTolerance
            How far the region reaches beyond the feature; default is the paper's.
        """
        return RULES[self.kind].region(self, tolerance)


@dataclass(frozen=True, kw_only=True)
class Part:
    """A part and the features on it.

    Parameters
    ----------
    name : str
        Name of the part.
    features : tuple of Feature
        At least one, with unique names.

    Raises
    ------
    FeatureError
        If the part has no name or no feature, or two features share a name.
    """

    name: str
    features: tuple[Feature, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "features", tuple(self.features))
        if not self.name.strip():
            msg = "a part needs a name, got an empty one"
            raise FeatureError(msg)
        check_plain(self.name, "the part", FeatureError)
        if not self.features:
            msg = f"part {self.name!r} has no feature; at least one is needed to measure anything"
            raise FeatureError(msg)
        check_unique_names(self.features)

    @cached_property
    def feature_poses(self) -> StackedPoses:
        """``part_from_feature`` of the features, in their order."""
        return StackedPoses.of([each.part_from_feature for each in self.features])

    def measured_regions(
        self, tolerance: RingTolerance = PAPER_TOLERANCE
    ) -> tuple[HollowCylinder, ...]:
        """Return `Feature.measured_region` of each feature, computed once."""
        if tolerance not in self._regions:
            self._regions[tolerance] = tuple(
                each.measured_region(tolerance) for each in self.features
            )
        return self._regions[tolerance]

    @cached_property
    def _regions(self) -> dict[RingTolerance, tuple[HollowCylinder, ...]]:
        return {}

    def feature(self, name: str) -> Feature:
        """Return the feature of a given name.

        Raises
        ------
        FeatureError
            If there is none.
        """
        for feature in self.features:
            if feature.name == name:
                return feature
        known = ", ".join(feature.name for feature in self.features[:10])
        msg = (
            f"part {self.name!r} has no feature {name!r}; its {len(self.features)} features begin "
            f"with {known}"
        )
        raise FeatureError(msg)


def check_unique_names(features: tuple[Feature, ...]) -> None:
    """Check that no two features share a name.

    Raises
    ------
    FeatureError
        If two do; the message names them.
    """
    first_at: dict[str, int] = {}
    for position, feature in enumerate(features, start=1):
        if feature.name in first_at:
            msg = (
                f"feature {feature.name!r} is there twice, as number {first_at[feature.name]} and "
                f"number {position}; give every feature a unique name"
            )
            raise FeatureError(msg)
        first_at[feature.name] = position


@dataclass(frozen=True, kw_only=True)
class KindRule:
    """How a kind of feature is checked and measured.

    Parameters
    ----------
    region : callable
        Returns the measured region in the feature's frame.
    has_length : bool
        Whether it has a length along its x axis and a width along its y axis.
    smallest_radius_mm : float or None, mm
        The radius must be at least this; None where it must be above 0.
    fault : callable
        Says what is wrong with sizes that are finite and positive; empty where nothing is.
    """

    region: Callable[[Feature, RingTolerance], HollowCylinder]
    has_length: bool = False
    smallest_radius_mm: float | None = None
    fault: Callable[[Feature], str] = lambda _: ""


def _length_and_width(feature: Feature) -> tuple[float, float]:
    if feature.length_mm is None or feature.width_mm is None:
        msg = f"a {feature.kind} needs length_mm and width_mm"
        raise FeatureError(msg)
    return feature.length_mm, feature.width_mm


def _ring(
    radius_mm: float, tolerance: RingTolerance, core_half_size_mm: tuple[float, float] = (0.0, 0.0)
) -> HollowCylinder:
    return HollowCylinder(
        inner_mm=radius_mm + tolerance.inner_mm,
        outer_mm=radius_mm + tolerance.outer_mm,
        height_mm=tolerance.height_mm,
        core_half_size_mm=core_half_size_mm,
    )


def _slot_fault(slot: Feature) -> str:
    length, width = _length_and_width(slot)
    if length < width:
        return f"a slot's length_mm must be at least its width_mm {width:g}, got {length:g}"
    if not math.isclose(2 * slot.radius_mm, width, rel_tol=1e-6):
        return f"a slot's radius_mm is half its width_mm, {width / 2:g}, got {slot.radius_mm:g}"
    return ""


def _slot_region(slot: Feature, tolerance: RingTolerance) -> HollowCylinder:
    length, width = _length_and_width(slot)
    return _ring(width / 2, tolerance, ((length - width) / 2, 0.0))


def _pocket_fault(pocket: Feature) -> str:
    length, width = _length_and_width(pocket)
    if 2 * pocket.radius_mm > min(length, width):
        return (
            f"a pocket's radius_mm is that of its corners, at most {min(length, width) / 2:g} for "
            f"{length:g} × {width:g} mm, got {pocket.radius_mm:g}"
        )
    return ""


def _pocket_region(pocket: Feature, tolerance: RingTolerance) -> HollowCylinder:
    length, width = _length_and_width(pocket)
    core = (length / 2 - pocket.radius_mm, width / 2 - pocket.radius_mm)
    return _ring(pocket.radius_mm, tolerance, core)


def _surface_point_region(point: Feature, tolerance: RingTolerance) -> HollowCylinder:
    return HollowCylinder(inner_mm=0.0, outer_mm=point.radius_mm, height_mm=tolerance.height_mm)


def _sphere_region(sphere: Feature, tolerance: RingTolerance) -> HollowCylinder:
    # A sphere's area is spread evenly along its axis (Archimedes), so the cap's mean height is
    # halfway between its pole and its rim. z points into the material: the pole is at −radius.
    cos_rim = math.cos(math.radians(SPHERE_CAP_DEG))
    return HollowCylinder(
        inner_mm=0.0,
        outer_mm=sphere.radius_mm * math.sin(math.radians(SPHERE_CAP_DEG)),
        height_mm=sphere.radius_mm * (1 - cos_rim) + tolerance.height_mm,
        plane_z_mm=-sphere.radius_mm * (1 + cos_rim) / 2,
    )


RULES: Mapping[FeatureKind, KindRule] = MappingProxyType(
    {
        "hole": KindRule(region=lambda hole, tolerance: _ring(hole.radius_mm, tolerance)),
        "slot": KindRule(region=_slot_region, has_length=True, fault=_slot_fault),
        "pocket": KindRule(
            region=_pocket_region, has_length=True, fault=_pocket_fault, smallest_radius_mm=0.0
        ),
        "sphere": KindRule(region=_sphere_region),
        "surface_point": KindRule(region=_surface_point_region),
    }
)
"""What each kind of feature is (sizes in ``docs/formats.md``, "Features")."""

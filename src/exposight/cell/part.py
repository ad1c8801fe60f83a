"""Features, and the part that carries them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.cell.kinds import (
    PAPER_TOLERANCE,
    RULES,
    FeatureKind,
    FeatureSize,
    RingTolerance,
)
from exposight.errors import FeatureError

if TYPE_CHECKING:
    from exposight.geometry import HollowCylinder, RigidTransform


@dataclass(frozen=True, kw_only=True)
class Feature:
    """A place on a part that shall be measured.

    Parameters
    ----------
    name : str
        Unique on its part.
    kind : {'hole', 'slot', 'pocket', 'sphere', 'surface_point'}
        What it is; `exposight.cell.RULES` says what each kind's sizes mean.
    part_from_feature : RigidTransform
        Where it is on the part: origin at its centre on the surface (of a sphere: at its centre),
        z along the surface normal into the material, x along the length of a slot or pocket.
    radius_mm : float, mm
        Radius of a hole or sphere, of a slot's ends, of a pocket's corners, of the disc about a
        surface point.
    length_mm, width_mm : float, mm, optional
        Overall length along x and width along y; slots and pockets only.

    Raises
    ------
    FeatureError
        If the kind is unknown, a size is missing, not finite or not positive, or the sizes
        contradict each other. The message names the feature.
    """

    name: str
    kind: FeatureKind
    part_from_feature: RigidTransform
    radius_mm: float
    length_mm: float | None = None
    width_mm: float | None = None

    def __post_init__(self) -> None:
        if not self.name.strip() or self.name != self.name.strip() or not self.name.isprintable():
            msg = f"a feature needs a printable name without blanks at its ends, got {self.name!r}"
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
        return rule.fault(self.size)

    @property
    def size(self) -> FeatureSize:
        """The feature's sizes in mm."""
        return FeatureSize(
            radius_mm=self.radius_mm, length_mm=self.length_mm, width_mm=self.width_mm
        )

    def measured_region(self, tolerance: RingTolerance = PAPER_TOLERANCE) -> HollowCylinder:
        """Return the region whose points and pixels are counted, in the feature's frame (Eq. 4).

        Parameters
        ----------
        tolerance : RingTolerance
            How far the region reaches beyond the feature; default is the paper's.
        """
        return RULES[self.kind].region(self.size, tolerance)


@dataclass(frozen=True, kw_only=True)
class Part:
    """A part and the features on it.

    Parameters
    ----------
    name : str
        What people call it.
    features : tuple of Feature
        At least one, each with a name of its own.

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
        if not self.features:
            msg = f"part {self.name!r} has no feature; at least one is needed to measure anything"
            raise FeatureError(msg)
        check_unique_names(self.features)

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
                f"number {position}; give every feature a name of its own"
            )
            raise FeatureError(msg)
        first_at[feature.name] = position

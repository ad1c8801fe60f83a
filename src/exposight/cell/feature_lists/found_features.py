"""Features of a part from the holes that were found in its mesh."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from exposight.cell.part import Feature, FeatureKind
from exposight.geometry import RigidTransform, rotation_facing
from exposight.geometry.meshes.mesh_holes import Opening

Side = Literal["x", "-x", "y", "-y", "z", "-z", "both"]

KINDS: Mapping[str, FeatureKind] = MappingProxyType(
    {"circle": "hole", "slot": "slot", "rectangle": "pocket", "ball": "sphere"}
)
"""The kind of feature that each outline is."""

_SIDEWAYS = 0.1
"""Cosine below which a side of a through hole faces a direction as little as the other one."""

_DECIMALS = 4
"""Lengths are given to 0.1 µm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundFeature:
    """A feature, and the opening of the mesh that it is; None where the mesh has no rim of it."""

    feature: Feature
    opening: Opening | None


def on_one_side(openings: Iterable[Opening], side: Side = "z") -> list[Opening]:
    """Return the openings to be measured: of a through hole the one that faces a side.

    Parameters
    ----------
    openings : iterable of Opening
        Of `find_holes`.
    side : {'x', '-x', 'y', '-y', 'z', '-z', 'both'}
        Direction of the part's frame. Holes across it are taken on the side that faces z, y or x,
        the first of them that tells the sides apart.
    """
    openings = list(openings)
    if side == "both":
        return openings
    chosen = []
    sides = Counter(opening.hole for opening in openings)
    for opening in openings:
        facing = _facing(opening.normal, side)
        if opening.depth != "through" or facing > 0 or sides[opening.hole] < 2:
            chosen.append(opening)
    return chosen


def _facing(normal: NDArray[np.float64], side: str) -> float:
    axes = {"x": 0, "y": 1, "z": 2}
    asked = normal[axes[side[-1]]] * (-1.0 if side.startswith("-") else 1.0)
    for cosine in (asked, normal[2], normal[1], normal[0]):
        if abs(cosine) > _SIDEWAYS:
            return float(cosine)
    return 1.0


def features_of(openings: Iterable[Opening], finish: str = "") -> list[FoundFeature]:
    """Return features with names by kind and position: ``hole_01`` has the least x.

    Parameters
    ----------
    openings : iterable of Opening
        Of `on_one_side`.
    finish : str
        The surface that they are on.
    """
    kinds: dict[str, list[Opening]] = {}
    for opening in openings:
        kinds.setdefault(KINDS[opening.outline], []).append(opening)
    found: list[FoundFeature] = []
    for kind in ("hole", "slot", "pocket", "sphere"):
        alike = sorted(kinds.get(kind, []), key=_order)
        digits = max(2, len(str(len(alike))))
        found.extend(
            FoundFeature(
                feature=feature_at(opening, f"{kind}_{number:0{digits}d}", finish), opening=opening
            )
            for number, opening in enumerate(alike, start=1)
        )
    return found


def _order(opening: Opening) -> tuple[float, ...]:
    return (*np.round(opening.centre_mm, 1).tolist(), *np.round(opening.normal, 2).tolist())


def feature_at(opening: Opening, name: str, finish: str = "") -> Feature:
    """Return the feature that an opening is."""
    kind = KINDS[opening.outline]
    long = kind in ("slot", "pocket")
    width = round(float(opening.width_mm), _DECIMALS)
    radius = round(float(opening.radius_mm), _DECIMALS)
    length = max(round(float(opening.length_mm), _DECIMALS), width)
    return Feature(
        name=name,
        kind=kind,
        part_from_feature=RigidTransform(
            rotation=rotation_facing(-opening.normal, *([opening.direction] if long else [])),
            translation_mm=np.round(opening.centre_mm, _DECIMALS),
        ),
        radius_mm=width / 2 if kind == "slot" else min(radius, width / 2) if long else radius,
        length_mm=length if long else None,
        width_mm=width if long else None,
        finish=finish,
    )

"""A user's list of features held against what was found in the part's mesh."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from exposight.cell.feature_lists.found_features import KINDS, FoundFeature, feature_at
from exposight.cell.part import Feature, Part
from exposight.cell.placement import faces_under
from exposight.errors import ContradictionError, FeatureError, first_ten
from exposight.files import UNITS_MM, ambiguous, current_reading
from exposight.geometry import RigidTransform
from exposight.geometry.meshes.mesh_holes import Opening
from exposight.geometry.meshes.triangle_meshes import Mesh, spelled
from exposight.tables import counted

_SIZE_SHARE, _SIZE_MM = 0.05, 0.1
_OTHER_SKIN = 3.0
"""A listed place must be so many times nearer to a skin that faces away for that to be meant."""

_RIMS = ("hole", "slot")
"""Kinds that have a rim; pockets pressed into sheet, balls and points need none."""


@dataclass(frozen=True, kw_only=True)
class MatchedFeatures:
    """The features of a list, on the mesh.

    Parameters
    ----------
    found : tuple of FoundFeature
        In the list's order, with its names; place and sizes are the mesh's where it has the rim.
    others : tuple of Opening
        Holes of the part that the list does not name.
    notes : tuple of str
        Remarks.
    """

    found: tuple[FoundFeature, ...]
    others: tuple[Opening, ...]
    notes: tuple[str, ...]


def match_features(
    listed: Sequence[Feature],
    openings: Sequence[Opening],
    mesh: Mesh,
    source: Path,
    tolerance_mm: float = 1.0,
) -> MatchedFeatures:
    """Give the openings of a mesh the names of a list.

    Parameters
    ----------
    listed : sequence of Feature
        The list.
    openings : sequence of Opening
        All that were found, on both sides.
    mesh : Mesh
        The part, for features without a rim.
    source : Path
        The list's file, for messages.
    tolerance_mm : float, mm
        How far a listed place may be from the opening.

    Raises
    ------
    FeatureError
        If the part lacks features of the list, or two openings fit one.
    AmbiguousError
        If the list's sizes fit as diameters, or its normals if they point inward.
    ContradictionError
        If sizes disagree.
    """
    pairs: list[Opening | None] = []
    missing: list[Feature] = []
    double: list[str] = []
    # Without a rim nothing is found, and all of the list is taken from it.
    tree = cKDTree(np.array([each.centre_mm for each in openings]).reshape(-1, 3))
    for feature in listed:
        around = tree.query_ball_point(feature.part_from_feature.translation_mm, tolerance_mm)
        near = _near(feature, [openings[i] for i in sorted(around)])
        if len(near) > 1 and near[0][0] > 0.3 * near[1][0]:
            double.append(
                f"{feature.name!r} at {spelled(feature.part_from_feature.translation_mm)} lies "
                f"{near[0][0]:.3g} and {near[1][0]:.3g} mm from two"
            )
        pairs.append(near[0][1] if near else None)
        if not near and (feature.kind in _RIMS or not _on_mesh(feature, mesh)):
            missing.append(feature)
    if missing:
        raise FeatureError(_missing_message(missing, listed, openings, source, tolerance_mm))
    _check_normals(listed, pairs, source)
    taken: dict[int, str] = {}
    for feature, opening in zip(listed, pairs, strict=True):
        if opening is not None and id(opening) in taken:
            double.append(f"{taken[id(opening)]!r} and {feature.name!r} are at the same opening")
        elif opening is not None:
            taken[id(opening)] = feature.name
    if double:
        msg = (
            f"{source}: features and openings cannot be told apart within {tolerance_mm:g} mm: "
            f"{first_ten(double)}; give a smaller --tolerance, or mend the list"
        )
        raise FeatureError(msg)
    _check_sizes(listed, pairs, source)
    found = [
        FoundFeature(feature=feature, opening=None)
        if opening is None
        else FoundFeature(feature=_placed(feature, opening), opening=opening)
        for feature, opening in zip(listed, pairs, strict=True)
    ]
    kept = [each.feature.name for each in found if each.opening is None]
    named = {opening.hole for opening in pairs if opening is not None}
    notes = []
    if kept:
        notes.append(
            f"{counted(len(kept), 'feature')} without a rim taken as listed, the surface is there: "
            f"{first_ten(kept)}"
        )
    return MatchedFeatures(
        found=tuple(found),
        others=tuple(o for o in openings if o.hole not in named),
        notes=tuple(notes),
    )


def _placed(feature: Feature, opening: Opening) -> Feature:
    """Return a listed feature with the mesh's place and sizes; a ball keeps its direction."""
    found = replace(feature_at(opening, feature.name), finish=feature.finish)
    if opening.outline != "ball":
        return found
    pose = RigidTransform(
        rotation=feature.part_from_feature.rotation,
        translation_mm=found.part_from_feature.translation_mm,
    )
    return replace(found, part_from_feature=pose)


def _near(feature: Feature, openings: Sequence[Opening]) -> list[tuple[float, Opening]]:
    """Return the nearest opening of each hole that may be a feature, with the distance.

    Of a hole's two openings it is the one that faces the same way.
    """
    centre = feature.part_from_feature.translation_mm
    outward = -feature.part_from_feature.z_axis
    best: dict[int, tuple[float, float, Opening]] = {}
    for opening in openings:
        if KINDS[opening.outline] != feature.kind:
            continue
        distance = float(np.linalg.norm(opening.centre_mm - centre))
        away = opening.outline != "ball" and bool(opening.normal @ outward < 0)
        # Of a thin sheet both skins are near: a place on the one that faces away tells a normal
        # that points inward.
        cost = distance + (_OTHER_SKIN * distance + _SIZE_MM if away else 0.0)
        known = best.get(opening.hole)
        if known is None or cost < known[0]:
            best[opening.hole] = (cost, distance, opening)
    return sorted(((d, o) for _, d, o in best.values()), key=lambda pair: pair[0])


def _on_mesh(feature: Feature, mesh: Mesh) -> bool:
    _, nearest = faces_under(Part(name="part", features=(feature,)), mesh.vertices, mesh.faces)
    return bool((nearest >= 0).mean() > 0.5)


def _check_normals(
    listed: Sequence[Feature], pairs: Sequence[Opening | None], source: Path
) -> None:
    away = [
        feature.name
        for feature, opening in zip(listed, pairs, strict=True)
        if opening is not None
        and opening.outline != "ball"
        and -feature.part_from_feature.z_axis @ opening.normal < 0
    ]
    paired = sum(opening is not None for opening in pairs)
    if not away:
        return
    if len(away) == paired and current_reading().normals == "outward":
        msg = (
            f"{source}: all normals point into the part's material, though they are said to point "
            "outward: the mesh is inside out; turn it (open sheets: --sheet-normals inward)"
        )
        raise ContradictionError(msg)
    if len(away) == paired:
        raise ambiguous(
            source,
            "all normals point into the part's material.",
            "normals",
            {"inward": "they are turned", "outward": "the mesh is inside out: turn it"},
        )
    msg = (
        f"{source}: the normals of {counted(len(away), 'feature')} point into the part's material, "
        f"those of the others outward: {first_ten(away)}; turn them in the list"
    )
    raise ContradictionError(msg)


def _check_sizes(listed: Sequence[Feature], pairs: Sequence[Opening | None], source: Path) -> None:
    """Check that sizes agree; diameters and inches among them are named."""
    rows = []
    for feature, opening in zip(listed, pairs, strict=True):
        if opening is None:
            continue
        found = feature_at(opening, feature.name)
        for name in ("radius_mm", "length_mm", "width_mm"):
            a, b = getattr(feature, name), getattr(found, name)
            if a is not None and b is not None and max(a, b) > 0:
                rows.append((feature.name, name, a, b))
    off = [row for row in rows if abs(row[2] - row[3]) > max(_SIZE_MM, _SIZE_SHARE * row[3])]
    if not off:
        return
    round_ones = {feature.name for feature in listed if feature.kind == "hole"}
    radii = [a / b for who, name, a, b in rows if name == "radius_mm" and who in round_ones]
    for factor, remedy in (
        (2.0, "the list's radii are diameters: --read-as size=diameter"),
        (0.5, "the list's radii are half of the part's: diameters were taken for them twice"),
        (1 / 25.4, "the list's sizes are in inches: --read-as unit=inch"),
        (25.4, "the list's sizes were converted from inches twice"),
    ):
        if radii and np.mean(np.abs(np.array(radii) / factor - 1) < 0.03) > 0.8:
            msg = (
                f"{source}: {remedy}; {counted(len(radii), 'size')} compared with those "
                f"of the part, the first is {rows[0][2]:.4g} mm for {rows[0][3]:.4g} mm"
            )
            raise ContradictionError(msg)
    lines = [f"{who!r} {what} {a:.4g}, the part {b:.4g}" for who, what, a, b in off]
    msg = (
        f"{source}: {counted(len(off), 'size')} of the list disagree with the part by more than "
        f"{100 * _SIZE_SHARE:g} %: {first_ten(lines)}; correct the list, or take the part's "
        "version that it belongs to"
    )
    raise ContradictionError(msg)


def _missing_message(
    missing: Sequence[Feature],
    listed: Sequence[Feature],
    openings: Sequence[Opening],
    source: Path,
    tolerance_mm: float,
) -> str:
    lines = []
    for feature in missing:
        centre = feature.part_from_feature.translation_mm
        alike = [o for o in openings if KINDS[o.outline] == feature.kind]
        away = min((float(np.linalg.norm(o.centre_mm - centre)) for o in alike), default=None)
        nearest = "none found" if away is None else f"the nearest {away:.4g} mm away"
        lines.append(f"{feature.name!r} ({feature.kind} at {spelled(centre)}, {nearest})")
    moved = _explained_by_motion(listed, openings, tolerance_mm)
    remedy = moved or (
        "correct the list or take its features out; --tolerance MM and --radius MIN MAX widen what "
        "is accepted"
    )
    return (
        f"{source}: the part has no such feature within {tolerance_mm:g} mm for "
        f"{len(missing)} of {len(listed)}: {first_ten(lines)}; {remedy}"
    )


def _explained_by_motion(
    listed: Sequence[Feature], openings: Sequence[Opening], tolerance_mm: float
) -> str:
    """Say which unit, shift or rotation brings most of a list onto the part; empty without one."""
    rims = [f for f in listed if f.kind in _RIMS]
    if len(rims) < 2 or not openings:
        return ""
    places = np.array([f.part_from_feature.translation_mm for f in rims])
    targets = np.array([o.centre_mm for o in openings])
    tree = cKDTree(targets)
    needed = max(2, 0.8 * len(rims))

    def hits(points: NDArray[np.float64]) -> int:
        away, nearest = tree.query(points)
        return len(np.unique(nearest[away <= tolerance_mm]))

    for unit, scale in UNITS_MM.items():
        for factor, how in ((scale, f"in {unit}"), (1 / scale, f"mm taken for {unit}")):
            if factor != 1.0 and hits(places * factor) >= needed:
                return f"read as {how}, {hits(places * factor)} of them fit: --read-as unit={unit}"
    radii = np.array([f.radius_mm for f in rims])
    alike = np.abs(radii[:, None] - [o.radius_mm for o in openings]) < np.maximum(
        _SIZE_MM, _SIZE_SHARE * radii[:, None]
    )
    for i in range(min(len(rims), 5)):
        for shift in targets[alike[i]] - places[i]:
            if hits(places + shift) >= needed:
                return (
                    f"moved by {spelled(shift)} mm, {hits(places + shift)} of {len(rims)} fit: "
                    "list and mesh have different origins; move one of them"
                )
    return _explained_by_rotation(places, targets, alike, hits, needed)


def _explained_by_rotation(
    places: NDArray[np.float64],
    targets: NDArray[np.float64],
    alike: NDArray[np.bool_],
    hits: Callable[[NDArray[np.float64]], int],
    needed: float,
) -> str:
    if len(places) < 4 or len(targets) > 400:
        return ""
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    i, j = np.unravel_index(int(np.argmax(apart)), apart.shape)
    k = int(np.argmax(np.minimum(apart[i], apart[j])))
    chosen = np.array([i, j, k])
    between = np.linalg.norm(targets[:, None] - targets[None], axis=2)
    for a in np.flatnonzero(alike[i]):
        for b in np.flatnonzero(alike[j] & (np.abs(between[a] - apart[i, j]) < 0.5)):
            fits = (np.abs(between[a] - apart[i, k]) < 0.5) & (
                np.abs(between[b] - apart[j, k]) < 0.5
            )
            for c in np.flatnonzero(alike[k] & fits):
                moved = _moved(places, places[chosen], targets[[a, b, c]])
                if hits(moved) >= needed:
                    return (
                        f"turned and moved as a whole, {hits(moved)} of {len(places)} fit: list "
                        "and mesh are in different frames; export both in one"
                    )
    return ""


def _moved(
    points: NDArray[np.float64], source: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return points moved by the rigid motion that brings three onto three."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    return np.asarray((points - source.mean(axis=0)) @ turn.T + target.mean(axis=0))

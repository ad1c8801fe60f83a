"""The car door's design: every dimension of the part, in one table.

The paper's door is not public. This one has its character (Sect. 2.1, Fig. 4): inner sheet metal
with holes of 3–30 mm radius, pockets and beads, and features whose orientations before a sensor of
constant orientation span what Table 9 lists. Positions are free: the training and test features lie
within reach of views planned about f1, those measured from outside in a band of their own.
"""

import io
import logging
import math
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np

from exposight.cell import PAPER_TOLERANCE, Part
from exposight.errors import FileError
from exposight.files import KeptFiles
from exposight.twin.part import presses, sheet_shape
from exposight.twin.part.features_on_sheet import Ball, PocketFeature, SurfacePoint
from exposight.twin.part.scene import Scene, check_scene
from exposight.twin.part.sheet_mesh import MeshSettings, mesh_sheet
from exposight.twin.part.surfaces import FINISHES, Finish

OUTSIDE_ZONES: Final[tuple[tuple[float, Finish], ...]] = (
    (10.0, "primer"),
    (245.0, "paint"),
    (math.inf, "brushed"),
)
"""The outer skin's finish up to each x in mm: one zone for each of the paper's three groups of
outside features (f1 | f2, f3 | f4, f5). The inner skin and all walls are bare."""

_BALL_FINISH: Final[Finish] = "primer"
"""Reference balls are coated matt."""

_BEAD = presses.PressProfile(depth_mm=-3.5, bend_mm=3.5, wall_deg=50.0)


def _wall(depth_mm: float) -> presses.PressProfile:
    return presses.PressProfile(depth_mm=depth_mm, bend_mm=4.0, wall_deg=65.0)


def _pocket(
    left: float, right: float, top: float, bottom: float, corner: float, depth: float
) -> presses.Pocket:
    floor = presses.RoundedPolygon.rectangle(left, right, top, bottom, corner)
    return presses.Pocket(floor=floor, profile=_wall(depth))


def _bead(x0: float, y0: float, x1: float, y1: float) -> presses.Bead:
    return presses.Bead(start_mm=(x0, y0), end_mm=(x1, y1), profile=_BEAD)


def _hole(
    name: str,
    x: float,
    y: float,
    radius: float,
    w: float,
    p: float,
    side: sheet_shape.Side = "inside",
) -> sheet_shape.Hole:
    return sheet_shape.Hole(
        name=name, x_mm=x, y_mm=y, radius_mm=radius, side=side, orientation_deg=(w, p)
    )


_TRAINING = (  # Table 9, X: w 1…11°, p −3…1°
    _hole("f1", 20, 0, 8.0, 5.0, -2.0),
    _hole("f2", 120, -90, 12.0, 9.0, 0.8),
    _hole("f3", -70, -105, 5.0, 10.8, -2.8),
    _hole("f4", 95, 85, 20.0, 1.2, -1.2),
)
_MORE_TRAINING = (  # Table 9, eX⁺: w 1…11°, p −6…1°
    _hole("f5", 210, -20, 3.0, 5.8, 0.8),
    _hole("f6", 225, 90, 30.0, 1.2, -1.5),
    _hole("f7", -10, -175, 10.0, 10.8, -3.0),
    _hole("f8", -255, -110, 6.5, 8.0, -5.8),
    _hole("f9", 15, 160, 15.0, 2.6, -4.2),
)
_TEST = (  # Table 9, X test: w −1…5°, p −13…−3°
    _hole("f1_test", -90, 15, 6.0, 4.8, -3.2),
    _hole("f2_test", -165, -60, 16.0, 4.2, -7.5),
    _hole("f3_test", -60, 110, 25.0, 1.4, -5.4),
    _hole("f4_test", -200, 75, 4.0, -0.8, -12.8),
)
_OUTSIDE = (  # Table 9, X out: w −3…4°, p −2…0°; groups f1 | f2, f3 | f4, f5
    _hole("f1_out", -60, 262, 10.0, -2.8, -1.8, "outside"),
    _hole("f2_out", 70, 262, 5.0, 1.6, -1.2, "outside"),
    _hole("f3_out", 180, 255, 20.0, 3.8, -0.2, "outside"),
    _hole("f4_out", 300, 255, 8.0, 2.4, -0.6, "outside"),
    _hole("f5_out", 400, 250, 13.0, 0.6, -0.1, "outside"),
)
_OTHERS = tuple(
    sheet_shape.Hole(name=f"h{number:02d}", x_mm=x, y_mm=y, radius_mm=radius)
    for number, (x, y, radius) in enumerate(
        (
            (-455.0, -90.0, 4.0),
            (-400.0, -150.0, 10.0),
            (-340.0, -230.0, 7.0),
            (-150.0, -268.0, 12.0),  # on the platform
            (-215.0, -268.0, 5.0),  # on the platform
            (60.0, -265.0, 30.0),
            (140.0, -215.0, 3.0),
            (365.0, -45.0, 16.0),  # in the recess
            (465.0, -240.0, 6.0),
            (465.0, 90.0, 9.0),
            (370.0, 160.0, 9.0),  # on the small platform
            (-340.0, 170.0, 22.0),  # in the loudspeaker's dish
            (-380.0, 130.0, 4.0),  # in the loudspeaker's dish
            (-455.0, 300.0, 8.0),
            (-250.0, 270.0, 4.0),
            (450.0, 280.0, 11.0),
            (-10.0, -265.0, 18.0),
        ),
        start=1,
    )
)

_HOLES = _TRAINING + _MORE_TRAINING + _TEST + _OUTSIDE + _OTHERS


def _slot(
    name: str, x: float, y: float, length: float, width: float, direction_deg: float
) -> sheet_shape.Hole:
    return sheet_shape.Hole(
        name=name,
        x_mm=x,
        y_mm=y,
        radius_mm=width / 2,
        length_mm=length,
        direction_deg=direction_deg,
    )


def _small_pocket(
    name: str, x: float, y: float, length: float, width: float, depth: float
) -> PocketFeature:
    return PocketFeature(
        name=name,
        x_mm=x,
        y_mm=y,
        length_mm=length,
        width_mm=width,
        floor_radius_mm=4.0,
        profile=_wall(depth),
    )


# The paper's study has holes only; these are for campaigns of other kinds, far from every hole.
_SLOTS = (_slot("slot_1", -182, 148, 24, 8, 30), _slot("slot_2", -166, 28, 16, 6, 100))
_POCKETS = (
    _small_pocket("pocket_1", 232, -110, 40, 30, 6.0),
    _small_pocket("pocket_2", -180, -156, 60, 44, 8.0),
)
_BALLS = (
    Ball(name="sphere_1", x_mm=4, y_mm=-80, radius_mm=6.0),
    Ball(name="sphere_2", x_mm=100, y_mm=-8, radius_mm=10.0),
)
_POINTS = (
    SurfacePoint(name="point_1", x_mm=22, y_mm=92, radius_mm=5.0),
    SurfacePoint(name="point_2", x_mm=88, y_mm=162, radius_mm=8.0),
)

NeighbourKind = Literal["bead", "platform", "recess"]

NEIGHBOURS: Final[Mapping[str, tuple[NeighbourKind, float, float]]] = {
    "f2": ("platform", 10, 5.3),
    "f5": ("bead", 175, 5.9),
    "f8": ("platform", 109, 4.4),
    "f1_test": ("recess", 145, 3.6),
    "f2_test": ("recess", 119, 5.4),
    "f4_test": ("bead", 94, 5.3),
    "h02": ("recess", 308, 5.6),
    "h03": ("recess", 170, 3.8),
    "h06": ("recess", 14, 4.6),
    "h07": ("platform", 69, 3.2),
    "h08": ("platform", 221, 5.8),
    "h09": ("bead", 184, 5.3),
    "h16": ("bead", 283, 3.6),
    "h17": ("bead", 295, 5.0),
}
"""What is pressed beside half of the inside holes, as on real doors: the kind, its direction from
the hole in degrees from x towards y, and how far beyond the ring its foot begins, in mm.

Drawn with one seed before anything was measured; of each hole's draws the first that collides with
nothing (the tests draw them again)."""


def press_beside(
    hole: sheet_shape.Hole, kind: NeighbourKind, direction_deg: float, gap_mm: float
) -> presses.Press:
    """Return a short bead, or a step up or down, across a direction from a hole.

    Parameters
    ----------
    hole : Hole
        The hole. Bead and step are 20 mm and its radius long; assumed.
    kind : {'bead', 'platform', 'recess'}
        3.5 mm high, 5 mm high or 5 mm deep; steps are 16 mm wide.
    direction_deg : float, degrees
        Where it lies, from x towards y.
    gap_mm : float, mm
        How far beyond the ring, which ends 5 mm beyond the hole's edge, its foot begins.
    """
    angle = math.radians(direction_deg)
    away = np.array([math.cos(angle), math.sin(angle)])
    along = (10.0 + hole.radius_mm / 2) * np.array([-away[1], away[0]])
    profile = {"bead": _BEAD, "platform": _wall(-5.0), "recess": _wall(5.0)}[kind]
    foot_mm = hole.radius_mm + PAPER_TOLERANCE.outer_mm + gap_mm
    near = hole.centre_mm + (foot_mm + profile.width_mm) * away
    if kind == "bead":
        return _bead(*(near - along), *(near + along))
    far = near + 16.0 * away
    corners = np.array([near - along, near + along, far + along, far - along])
    floor = presses.RoundedPolygon(corners_mm=tuple(map(tuple, corners.tolist())), radius_mm=6.0)
    return presses.Pocket(floor=floor, profile=profile)


DOOR: Final = sheet_shape.SheetShape(
    outline=presses.RoundedPolygon(
        corners_mm=((-500, 350), (-500, -120), (-300, -350), (500, -350), (500, 350)),
        radius_mm=50.0,
    ),
    opening=presses.RoundedPolygon.rectangle(190, 430, -300, -170, 35.0),
    thickness_mm=1.2,
    rim_mm=0.4,
    pad_margin_mm=11.0,  # the ring's 5 mm, and more than 5 mm of smooth sheet round it
    pad_blend_mm=12.0,
    # Slopes and radii of curvature for which Table 9's orientations are near the sheet's own.
    slope_deg=(2.5, 5.0),
    crown_mm=(3000.0, 2200.0),
    presses=(
        _pocket(-415, -265, 95, 245, 70.0, 12.0),  # the loudspeaker's dish
        _pocket(300, 430, -110, 20, 25.0, 14.0),  # the handle's recess
        _pocket(-250, -60, -310, -225, 25.0, -9.0),  # a platform for a bracket
        _pocket(300, 440, 130, 190, 20.0, -8.0),  # a small platform
        presses.RingBead(centre_mm=(-340, 170), radius_mm=108.0, profile=_BEAD),
        _bead(-112, -190, -112, -40),
        _bead(60, -190, 60, -60),
        _bead(-40, 55, 50, 55),
        _bead(160, -40, 160, 140),
        _bead(-420, -60, -230, -10),
        _bead(-130, 60, -130, 200),
        _bead(80, 205, 240, 170),
        _bead(-220, 315, 440, 315),
        *(pocket.press for pocket in _POCKETS),
    ),
    holes=_HOLES + _SLOTS,
    neighbours=tuple(
        press_beside(hole, *NEIGHBOURS[hole.name]) for hole in _HOLES if hole.name in NEIGHBOURS
    ),
)
"""The door: 1.0 m × 0.7 m of 1.2 mm sheet."""

DOOR_MESH: Final = MeshSettings(
    lattice_mm=2.0,
    # Radii below 20 mm: a 2 mm edge then leaves the true surface by at most 0.025 mm outside beads
    # and the walls of pockets.
    fine_curvature_per_mm=0.05,
    rim_spacing_mm=0.3,
    border_spacing_mm=1.5,
    growth=1.25,
    arc_steps=3,  # 0.2 mm each
)
"""How finely the door is cut into triangles: about 1.3 million."""


logger = logging.getLogger(__name__)

CACHE_VARIABLE = "EXPOSIGHT_CACHE"
"""Environment variable that names another cache folder."""

_VERSION = 3
"""To be raised when the same design gives another mesh."""

_CACHED = "door.npz"


def build_door() -> Scene:
    """Build the door from its design; the same one every time, in some seconds.

    Returns
    -------
    Scene
        Three closed bodies (sheet and balls), about 1.3 million triangles; the inside bare, the
        outside in three zones.
    """
    mesh = mesh_sheet(DOOR, DOOR_MESH)
    x_mm = mesh.vertices[mesh.faces, 0].mean(axis=1)
    borders = [border for border, _ in OUTSIDE_ZONES[:-1]]
    zone_finish = np.array([FINISHES.index(finish) for _, finish in OUTSIDE_ZONES], dtype=np.uint8)
    bare = np.uint8(FINISHES.index("bare"))
    finish = np.where(mesh.outer, zone_finish[np.searchsorted(borders, x_mm, side="right")], bare)
    bodies = [(mesh.vertices, mesh.faces), *(ball.mesh(DOOR) for ball in _BALLS)]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in bodies)])
    faces = np.concatenate([of + start for (_, of), start in zip(bodies, starts, strict=False)])
    of_balls = np.full(len(faces) - len(finish), FINISHES.index(_BALL_FINISH), dtype=np.uint8)
    return check_scene(
        Scene(
            vertices=np.concatenate([vertices for vertices, _ in bodies]),
            faces=faces.astype(np.int32),
            face_finish=np.concatenate([finish, of_balls]),
            part=door_part(),
        )
    )


def door(cache: Path | None = None) -> Scene:
    """Return the door, from the cache where it is there and undamaged.

    Parameters
    ----------
    cache : Path, optional
        Folder of the cache; default is `cache_folder`.

    Returns
    -------
    Scene
        As `build_door` makes it.
    """
    decisive = (_VERSION, DOOR, DOOR_MESH, OUTSIDE_ZONES, _BALLS, _BALL_FINISH)
    kept = KeptFiles(Path(cache or cache_folder()), repr(decisive))
    path = kept.find(_CACHED)
    if path is not None:
        with np.load(path, allow_pickle=False) as archive:
            return Scene(**archive, part=door_part())
    scene = build_door()
    buffer = io.BytesIO()
    np.savez(buffer, vertices=scene.vertices, faces=scene.faces, face_finish=scene.face_finish)
    try:
        kept.path(_CACHED).parent.mkdir(parents=True, exist_ok=True)
        kept.keep(_CACHED, buffer.getvalue())
    except (OSError, FileError) as error:
        logger.warning("the door could not be cached (%s); it is built again next time", error)
    return scene


def cache_folder() -> Path:
    """Return the folder of exposight's cache: `CACHE_VARIABLE`, or the platform's own place."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "exposight"
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        return Path(local) / "exposight" / "Cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "exposight"


def door_part() -> Part:
    """Return the door with its 35 holes and the features of other kinds; no mesh is needed."""
    others = (*_POCKETS, *_BALLS, *_POINTS)
    features = (*map(DOOR.feature, DOOR.holes), *(other.feature(DOOR) for other in others))
    return Part(name="door", features=features)

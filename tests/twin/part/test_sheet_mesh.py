"""Pressed sheets in general: profiles, polygons, pads, and the mesh of a small flat plate."""

import dataclasses

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.observing import orientation_deg
from exposight.twin.part import (
    DOOR_MESH,
    Bead,
    Hole,
    Pocket,
    PressProfile,
    RingBead,
    RoundedPolygon,
    SheetShape,
    mesh_sheet,
)

PROFILE = PressProfile(depth_mm=10.0, bend_mm=4.0, wall_deg=60.0)
SQUARE = RoundedPolygon.rectangle(-40, 40, -30, 30, 10.0)


def sheet(*holes, presses=(), crown_mm=(np.inf, np.inf), slope_deg=(0.0, 0.0)):
    return SheetShape(
        outline=RoundedPolygon.rectangle(-60, 60, -50, 50, 10.0),
        opening=RoundedPolygon.rectangle(-50, -30, -40, -20, 8.0),
        thickness_mm=1.2,
        rim_mm=0.4,
        pad_margin_mm=11.0,
        pad_blend_mm=12.0,
        slope_deg=slope_deg,
        crown_mm=crown_mm,
        presses=tuple(presses),
        holes=holes,
    )


# -- presses -------------------------------------------------------------------------------------


def test_a_profile_leads_from_its_depth_to_the_sheet():
    rise = PROFILE.rise_mm(np.array([-5.0, 0.0, PROFILE.width_mm / 2, PROFILE.width_mm, 50.0]))
    assert rise == pytest.approx([10, 10, 5, 0, 0], abs=1e-9)


def test_a_profile_is_as_steep_as_its_wall_and_nowhere_steeper():
    distance = np.linspace(-1, PROFILE.width_mm + 1, 5001)
    slope = np.gradient(PROFILE.rise_mm(distance), distance)
    assert np.degrees(np.arctan(-slope.min())) == pytest.approx(60, abs=0.01)
    assert slope.max() < 1e-9


def test_a_profile_bends_by_its_radius():
    angle = np.radians(30)
    at = np.array([PROFILE.bend_mm * np.sin(angle)])
    expected = PROFILE.depth_mm - PROFILE.bend_mm * (1 - np.cos(angle))
    assert PROFILE.rise_mm(at) == pytest.approx([expected])


def test_a_negative_depth_rises_towards_the_inside():
    mirrored = dataclasses.replace(PROFILE, depth_mm=-10.0)
    distance = np.linspace(-1, 20, 50)
    assert mirrored.rise_mm(distance) == pytest.approx(-PROFILE.rise_mm(distance))


def test_a_profile_too_shallow_for_its_bends_is_refused():
    with pytest.raises(InputError, match=r"wall of 60°.*deeper than 3 mm; lower the angle"):
        PressProfile(depth_mm=3.0, bend_mm=4.0, wall_deg=60.0)


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((0, 0), -30),
        ((39, 0), -1),
        ((45, 0), 5),
        ((30 + 20 / np.sqrt(2), 20 + 20 / np.sqrt(2)), 10),
        ((30 + 10 / np.sqrt(2), 20 + 10 / np.sqrt(2)), 0),
    ],
)
def test_distance_to_a_rounded_polygon(point, distance):
    assert SQUARE.distance_mm(np.array([point], dtype=float)) == pytest.approx([distance])


@pytest.mark.parametrize("turn", [1, -1])
def test_an_outline_follows_the_border_evenly(turn):
    polygon = RoundedPolygon(
        corners_mm=((-50, 40), (-50, -20), (0, -40), (50, 40))[::turn], radius_mm=8
    )
    outline = polygon.outline(1.0)
    steps = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
    assert polygon.distance_mm(outline) == pytest.approx(np.zeros(len(outline)), abs=1e-9)
    assert steps.max() <= 1.0 + 1e-9
    assert steps.min() > 0.5
    x, y = outline.T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0


@pytest.mark.parametrize(
    "press",
    [
        Pocket(floor=RoundedPolygon.rectangle(-10, 10, -8, 8, 5.0), profile=PROFILE),
        Bead(start_mm=(-20, 0), end_mm=(20, 5), profile=PROFILE),
        RingBead(centre_mm=(0, 0), radius_mm=25.0, profile=PROFILE),
    ],
    ids=["pocket", "bead", "ring bead"],
)
def test_presses_end_where_their_wall_ends(press):
    shape = sheet(presses=[press])
    xy = np.random.default_rng(0).uniform(-60, 60, (4000, 2))
    height, distance = shape.height_mm(xy), press.distance_mm(xy)
    assert height == pytest.approx(press.profile.rise_mm(distance), abs=1e-9)
    assert height[distance > press.profile.width_mm] == pytest.approx(0, abs=1e-9)
    assert height.max() == pytest.approx(10, abs=0.2)


# -- pads ----------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(
    w=st.floats(-15, 15),
    p=st.floats(-15, 15),
    side=st.sampled_from(["inside", "outside"]),
)
def test_a_pad_gives_its_feature_the_orientation_asked_for(w, p, side):
    hole = Hole(name="f", x_mm=10, y_mm=5, radius_mm=6, side=side, orientation_deg=(w, p))
    shape = sheet(hole, crown_mm=(2000.0, 1500.0), slope_deg=(3.0, -4.0))
    before = RigidTransform.from_fanuc_wpr((0, 0, 0), 0, 180 if side == "outside" else 0, 0)
    feature = shape.feature(hole)
    seen = orientation_deg(feature, before @ feature.part_from_feature)
    assert seen == pytest.approx((w, p, 0), abs=1e-5)


def test_a_pad_is_flat_round_its_hole_and_gone_further_out():
    hole = Hole(name="f", x_mm=10, y_mm=5, radius_mm=6, orientation_deg=(8.0, -6.0))
    shape = sheet(hole, crown_mm=(500.0, 500.0))
    bare = dataclasses.replace(shape, holes=())
    frame = shape.frame(hole.centre_mm)
    xy = np.random.default_rng(1).uniform(-60, 60, (4000, 2))
    distance = np.linalg.norm(xy - hole.centre_mm, axis=1)
    off_plane = (shape.points(xy) - frame.translation_mm) @ frame.z_axis
    assert off_plane[distance < 17] == pytest.approx(0, abs=1e-6)
    beyond = distance > 29
    assert shape.height_mm(xy)[beyond] == pytest.approx(bare.height_mm(xy)[beyond])


def test_an_outside_feature_lies_one_thickness_further_and_looks_back():
    hole = Hole(name="f", x_mm=10, y_mm=5, radius_mm=6, side="outside")
    pose = sheet(hole).feature(hole).part_from_feature
    assert pose.translation_mm == pytest.approx([10, 5, 1.2])
    assert pose.z_axis == pytest.approx([0, 0, -1])


# -- mesh ----------------------------------------------------------------------------------------


def test_a_flat_plate_has_its_closed_form_volume():
    hole = Hole(name="f", x_mm=20, y_mm=5, radius_mm=10)
    shape = sheet(hole)
    plate = mesh_sheet(shape, DOOR_MESH)
    mesh = trimesh.Trimesh(plate.vertices, plate.faces, process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2 - 2 * 2
    # borders of the body, one rim radius beyond those of the skins
    rim, thickness = shape.rim_mm, shape.thickness_mm
    area = 120 * 100 - (4 - np.pi) * 100 + rim * (4 * 10 * np.pi / 2 + 2 * (100 + 80))
    area -= 20 * 20 - (4 - np.pi) * 64 - rim * (2 * np.pi * 8 + 4 * 4)
    area -= np.pi * 10**2
    border = 2 * np.pi * 10 + 360 + 2 * np.pi * 8 + 16 + 2 * np.pi * 10
    steps = DOOR_MESH.arc_steps
    rounded_off = 2 * rim**2 * (1 - steps / 2 * np.sin(np.pi / 2 / steps)) * border
    assert mesh.volume == pytest.approx(area * thickness - rounded_off, rel=2e-4)


def test_a_hole_in_a_tilted_sheet_is_round():
    hole = Hole(name="f", x_mm=10, y_mm=5, radius_mm=12)
    shape = sheet(hole, slope_deg=(20.0, -15.0))
    plate = mesh_sheet(shape, DOOR_MESH)
    local = shape.frame(hole.centre_mm).inverse().apply(plate.vertices)
    radius = np.hypot(local[:, 0], local[:, 1])
    rim = radius[radius < 12.2]
    wall = rim[rim < 12 + 1e-6]
    assert rim.min() == pytest.approx(12, abs=1e-6)
    assert len(wall) == 2 * np.ceil(2 * np.pi * 12.4 / DOOR_MESH.rim_spacing_mm)


def test_a_slot_in_a_tilted_sheet_has_straight_sides_and_round_ends():
    slot = Hole(name="s", x_mm=10, y_mm=5, radius_mm=4, length_mm=24, direction_deg=30)
    shape = sheet(slot, slope_deg=(20.0, -15.0))
    plate = mesh_sheet(shape, DOOR_MESH)
    mesh = trimesh.Trimesh(plate.vertices, plate.faces, process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2 - 2 * 2
    feature = shape.feature(slot)
    assert (feature.kind, feature.length_mm, feature.width_mm) == ("slot", 24, 8)
    x, y, _ = feature.part_from_feature.inverse().apply(plate.vertices).T
    distance = np.hypot(np.clip(np.abs(x) - 8, 0, None), y)
    wall = distance < 4.01
    assert distance[wall] == pytest.approx(4, abs=0.01)
    assert (x[wall].min(), x[wall].max()) == pytest.approx((-12, 12), abs=0.01)
    rim = 2 * np.pi * 4.4 + 2 * 16
    assert wall.sum() == 2 * np.ceil(rim / DOOR_MESH.rim_spacing_mm)


def test_a_slot_has_a_pad_along_its_length():
    tilt = (8.0, -6.0)
    slot = Hole(name="s", x_mm=0, y_mm=5, radius_mm=4, length_mm=24, orientation_deg=tilt)
    shape = sheet(slot, crown_mm=(500.0, 500.0))
    xy = np.random.default_rng(1).uniform(-40, 40, (4000, 2))
    frame = shape.frame(slot.centre_mm)
    off_plane = np.abs((shape.points(xy) - frame.translation_mm) @ frame.z_axis)
    assert off_plane[slot.distance_mm(xy) < 11].max() < 1e-6
    beyond = slot.distance_mm(xy) > 23
    bare = dataclasses.replace(shape, holes=())
    assert shape.height_mm(xy)[beyond] == pytest.approx(bare.height_mm(xy)[beyond])


def test_a_bend_is_cut_more_finely():
    bead = Bead(start_mm=(0, -30), end_mm=(0, 30), profile=PROFILE)
    plate = mesh_sheet(sheet(presses=[bead]), DOOR_MESH)
    inner = plate.vertices[np.unique(plate.faces[~plate.outer])]
    on_bead = np.abs(inner[:, 0]) < PROFILE.width_mm
    on_bead &= np.abs(inner[:, 1]) < 25
    flat = (inner[:, 0] > 25) & (inner[:, 0] < 50) & (np.abs(inner[:, 1]) < 25)
    density = on_bead.sum() / (2 * PROFILE.width_mm * 50), flat.sum() / (25 * 50)
    assert density[1] == pytest.approx(2 / np.sqrt(3) / 2.0**2, rel=0.05)
    assert density[0] > 2 * density[1]


def test_the_same_sheet_gives_the_same_mesh():
    shape = sheet(Hole(name="f", x_mm=10, y_mm=5, radius_mm=12), crown_mm=(900.0, 800.0))
    first, second = mesh_sheet(shape, DOOR_MESH), mesh_sheet(shape, DOOR_MESH)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)

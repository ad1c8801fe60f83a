"""Candidate viewpoints: what hides and shadows where geometry says so, and poses that see much."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from exposight.cell import Feature, Part, sensor_preset
from exposight.errors import FeatureError, InputError
from exposight.geometry import HollowCylinder, RigidTransform
from exposight.geometry.meshes.triangle_meshes import Mesh
from exposight.observing import View
from exposight.planning.viewing.ring_visibility import (
    RingVisibility,
    Sight,
    ViewingLimits,
    ring_points,
)
from exposight.planning.viewing.sensor_poses import ReachBox
from exposight.planning.viewing.viewpoints import candidate_views

COMET, VISARD = sensor_preset("comet-pro-ae"), sensor_preset("rc-visard-65")
INTO_PLATE = np.diag([1.0, -1.0, -1.0])
"""Turns z from the plate's normal into it: of features, and of a camera that looks at the plate."""

WALL_X = 30.0
RADIUS = 5.0


def _hole(name: str, x: float = 0.0, y: float = 0.0, normal_up: bool = True) -> Feature:
    rotation = INTO_PLATE if normal_up else np.eye(3)
    pose = RigidTransform(rotation=rotation, translation_mm=np.array([x, y, 0.0]))
    return Feature(name=name, kind="hole", part_from_feature=pose, radius_mm=RADIUS)


def _mesh(*bodies: trimesh.Trimesh) -> Mesh:
    whole = trimesh.util.concatenate(bodies)
    return Mesh(vertices=np.array(whole.vertices), faces=np.array(whole.faces, dtype=np.int32))


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


PLATE = _box((-400, -400, -2), (400, 400, 0))


def _above(height_mm: float, x: float = 0.0) -> RigidTransform:
    """camera_from_part of a camera that looks straight down."""
    return RigidTransform(rotation=INTO_PLATE, translation_mm=np.array([-x, 0.0, height_mm]))


def _look(mesh: Mesh | None, pose: RigidTransform, sensor=COMET) -> tuple[float, Sight]:
    part = Part(name="plate", features=(_hole("a"),))
    share, sight = RingVisibility(part, sensor, mesh, ViewingLimits()).look(pose)
    return float(share[0]), Sight(int(sight[0]))


@given(height=st.floats(5.0, 200.0))
def test_a_wall_shadows_the_points_whose_light_it_cuts(height: float) -> None:
    wall = _box((WALL_X, -300, 0), (WALL_X + 1, 300, height))
    share, sight = _look(_mesh(PLATE, wall), _above(600.0))
    lamp = COMET.projector.camera_from_projector.translation_mm
    lamp_x, lamp_z = lamp[0], 600.0 - lamp[2]
    region = _hole("a").measured_region()
    x = ring_points(region, 24)[:, 0]
    # Light to a point at x crosses the wall's two faces at these heights.
    crossing = np.array([(face - x) / (lamp_x - x) * lamp_z for face in (WALL_X, WALL_X + 1)])
    clear = (crossing > height + 0.5).all(axis=0).mean()
    dark = (crossing[0] < height - 0.5).mean()
    assert clear - 1e-9 <= share <= 1.0 - dark + 1e-9
    if share < 0.85:
        assert sight is Sight.SHADOWED
    else:
        assert sight is Sight.SEEN


def test_a_projector_that_is_not_known_casts_no_shadow() -> None:
    wall = _box((WALL_X, -300, 0), (WALL_X + 1, 300, 200))
    blind = replace(COMET, projector=None)
    assert _look(_mesh(PLATE, wall), _above(600.0), blind) == (1.0, Sight.SEEN)


def test_a_roof_hides_from_the_camera_what_the_projector_still_lights() -> None:
    # At 100 mm the camera's rays to the ring pass within 10 mm of the axis, the light's at +39.
    roof = _box((-12, -300, 100), (12, 300, 101))
    share, sight = _look(_mesh(PLATE, roof), _above(600.0))
    assert (share, sight) == (0.0, Sight.HIDDEN)


def test_stereo_needs_both_cameras() -> None:
    # The second camera stands 65 mm to the right: 100 of 500 mm up, its rays pass at 0.8·x + 13,
    # those of the first at 0.8·x, up to 7.3.
    roof = _box((7.5, -300, 100), (30, 300, 101))
    assert _look(_mesh(PLATE), _above(500.0), VISARD)[1] is Sight.SEEN
    share, sight = _look(_mesh(PLATE, roof), _above(500.0), VISARD)
    x = ring_points(_hole("a").measured_region(), 24)[:, 0]
    assert share == np.mean(0.8 * x + 13.0 < 7.5)
    assert sight is Sight.HIDDEN


def test_what_geometry_alone_forbids() -> None:
    assert _look(None, _above(900.0))[1] is Sight.OUT_OF_RANGE
    assert _look(None, _above(600.0, x=400.0))[1] is Sight.OUT_OF_FRAME
    away = RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0]))
    assert _look(None, away)[1] is Sight.FACING_AWAY


def test_a_ring_over_the_plates_edge_is_seen_to_the_share_that_lies_on_it() -> None:
    half = _mesh(_box((-400, -400, -2), (0.01, 400, 0)))
    share, sight = _look(half, _above(600.0))
    assert share == pytest.approx(0.5, abs=1 / 24)
    assert sight is Sight.OFF_MESH


@pytest.mark.parametrize("core", [(0.0, 0.0), (20.0, 0.0), (10.0, 5.0)])
def test_ring_points_lie_evenly_in_the_middle_of_the_area(core: tuple[float, float]) -> None:
    region = HollowCylinder(inner_mm=8, outer_mm=10, height_mm=20, core_half_size_mm=core)
    points = ring_points(region, 24)
    beside = np.maximum(np.abs(points[:, :2]) - core, 0.0)
    assert np.hypot(*beside.T) == pytest.approx(np.sqrt((64 + 100) / 2), rel=0.01)
    steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    assert steps == pytest.approx(steps.mean(), rel=0.05)


FIELD = Part(
    name="plate",
    features=tuple(
        _hole(f"h{i}{j}", 120.0 * i - 300.0, 150.0 * j - 225.0) for i in range(6) for j in range(4)
    ),
)
WALLED = _mesh(PLATE, _box((45, -300, 0), (50, 300, 90)))


def test_every_candidate_sees_what_it_says() -> None:
    found = candidate_views(FIELD, COMET, mesh=WALLED, count=12, seed=3)
    assert len(found.views) == 12
    assert not found.unreachable
    assert not found.notes
    rings = RingVisibility(FIELD, COMET, WALLED, ViewingLimits())
    names = [feature.name for feature in FIELD.features]
    for view in found.views:
        shares, _ = rings.look(view.camera_from_part)
        visible = View.of(FIELD, COMET, view.camera_from_part).visible
        assert set(view.features) <= {each.feature.name for each in visible}
        for name, share in zip(view.features, view.shares, strict=True):
            assert share == shares[names.index(name)] >= 0.85
        assert [f.feature.name for f in view.view(FIELD, COMET).visible] == list(view.features)
    assert {name for view in found.views for name in view.features} == set(names)
    assert max(len(view.features) for view in found.views) >= 8


def test_few_views_suffice_to_see_everything_once() -> None:
    found = candidate_views(FIELD, COMET, mesh=WALLED, count=5, seed=3)
    assert {name for view in found.views for name in view.features} == {
        feature.name for feature in FIELD.features
    }


def test_the_same_seed_gives_the_same_views_and_another_others() -> None:
    one, again, other = (
        candidate_views(FIELD, COMET, mesh=WALLED, count=6, seed=seed) for seed in (1, 1, 2)
    )
    assert one.poses == again.poses
    assert one.poses != other.poses


def test_a_part_that_stands_elsewhere_has_the_same_views() -> None:
    moved_from_part = RigidTransform.from_fanuc_wpr((700.0, -400.0, 250.0), 25.0, -40.0, 130.0)
    moved = Part(
        name="plate",
        features=tuple(
            Feature(
                name=f.name,
                kind="hole",
                part_from_feature=moved_from_part @ f.part_from_feature,
                radius_mm=f.radius_mm,
            )
            for f in FIELD.features
        ),
    )
    mesh = Mesh(vertices=moved_from_part.apply(WALLED.vertices), faces=WALLED.faces)
    box = {"low_mm": (-350, -300, 300), "high_mm": (350, 300, 900)}
    here = candidate_views(FIELD, COMET, mesh=WALLED, reach=ReachBox(**box), count=6, seed=5)
    there = candidate_views(
        moved,
        COMET,
        mesh=mesh,
        reach=ReachBox(**box, part_from_box=moved_from_part),
        count=6,
        seed=5,
    )
    for one, other in zip(here.views, there.views, strict=True):
        assert one.features == other.features
        back = other.camera_from_part @ moved_from_part
        assert np.allclose(back.to_matrix(), one.camera_from_part.to_matrix(), atol=1e-6)


@pytest.mark.parametrize("point", ["camera", "tcp"])
def test_views_stay_in_reach(point: str) -> None:
    low, high = (
        ((-100, -300, 450), (0, 300, 520)) if point == "camera" else ((-50, -50, -80), (50, 50, 20))
    )
    reach = ReachBox(low_mm=low, high_mm=high, point=point)
    found = candidate_views(FIELD, COMET, mesh=WALLED, reach=reach, count=10, seed=1)
    held = np.zeros(3) if point == "camera" else COMET.camera_from_tcp.translation_mm
    for pose in found.poses.values():
        place = pose.inverse().apply(held)
        assert (place >= np.array(low) - 1e-6).all()
        assert (place <= np.array(high) + 1e-6).all()


def test_of_listed_poses_some_are_kept_under_their_names() -> None:
    poses = {"left": _above(600, -150), "right": _above(600, 150), "useless": _above(600, 5000)}
    found = candidate_views(FIELD, COMET, mesh=WALLED, reach=poses)
    assert {name: poses[name] for name in ("left", "right")} == found.poses
    unnamed = candidate_views(FIELD, COMET, mesh=WALLED, reach=list(poses.values()))
    assert set(unnamed.poses) == {"pose-1", "pose-2"}
    assert found.unreachable  # the far columns


def test_without_a_mesh_nothing_is_hidden_and_that_is_said() -> None:
    found = candidate_views(FIELD, COMET, count=4, seed=3)
    assert "without a mesh" in found.notes[0]
    assert not found.unreachable


def test_features_that_no_view_sees_are_named_with_the_reason() -> None:
    part = Part(name="plate", features=(_hole("up"), _hole("under", 60.0)))
    lid = _box((30, -400, 40), (400, 400, 42))
    found = candidate_views(part, COMET, mesh=_mesh(PLATE, lid), count=4)
    assert list(found.unreachable) == ["under"]
    assert "hidden" in found.unreachable["under"] or "shadow" in found.unreachable["under"]


def test_a_part_of_which_nothing_is_seen_is_refused_feature_by_feature() -> None:
    part = Part(name="plate", features=(_hole("a"), _hole("b", 50.0)))
    far = ReachBox(low_mm=(-50, -50, 2000), high_mm=(50, 50, 2100))
    with pytest.raises(InputError, match="a, b: outside the working distance"):
        candidate_views(part, COMET, mesh=_mesh(PLATE), reach=far)


def test_a_mesh_in_metres_is_refused() -> None:
    small = Mesh(vertices=WALLED.vertices / 1000.0, faces=WALLED.faces)
    with pytest.raises(FeatureError, match="with a mesh in m instead of mm"):
        candidate_views(FIELD, COMET, mesh=small)


def test_what_cannot_be_meant() -> None:
    with pytest.raises(InputError, match="no pose is in it"):
        ReachBox(low_mm=(0, 0, 10), high_mm=(10, 10, 0))
    with pytest.raises(InputError, match="camera or the tcp"):
        ReachBox(low_mm=(0, 0, 0), high_mm=(1, 1, 1), point="flange")
    with pytest.raises(InputError, match="without a pose"):
        candidate_views(FIELD, COMET, reach=[])
    with pytest.raises(InputError, match="count of 0"):
        candidate_views(FIELD, COMET, count=0)
    with pytest.raises(InputError, match="90°"):
        ViewingLimits(incidence_deg=90.0)

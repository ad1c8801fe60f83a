"""Scenes: which arrays make one, and whether the features lie on the part."""

import dataclasses

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import Feature, Part
from exposight.cell.placement import _squared_distance
from exposight.errors import FeatureError, InputError
from exposight.files import UNITS_MM
from exposight.geometry import RigidTransform
from exposight.twin.part import Scene, Zone, check_scene


def feature_at(position_mm, kind="surface_point", radius_mm=30.0, **sizes):
    pose = RigidTransform(translation_mm=np.array(position_mm, dtype=float))
    return Feature(name="f1", kind=kind, part_from_feature=pose, radius_mm=radius_mm, **sizes)


def scene_of(mesh, *features, **changes):
    part = Part(name="box", features=features)
    finish = np.zeros(len(mesh.faces), dtype=np.uint8)
    return Scene(vertices=mesh.vertices, faces=mesh.faces, face_finish=finish, part=part, **changes)


@pytest.fixture
def box():
    """A closed box of 100 mm × 80 mm × 2 mm, a feature on it."""
    return scene_of(trimesh.creation.box(extents=(100, 80, 2)), feature_at((40, 30, -1)))


def changed(scene, **arrays):
    return dataclasses.replace(scene, **arrays)


def sheet(size_mm, z_mm=0.0):
    """Return a square of two triangles."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size_mm / 2
    vertices = np.column_stack([square, np.full(4, z_mm)])
    return trimesh.Trimesh(vertices, [(0, 1, 2), (0, 2, 3)], process=False)


def test_a_feature_is_on_the_finish_under_most_of_its_ring(box):
    names = tuple(box.surfaces)
    finish = np.where(box.vertices[box.faces][..., 2].max(axis=1) < 0, 1, 2)  # of the lower side
    part = Part(name="box", features=(feature_at((10, 5, -1)),))
    scene = changed(box, face_finish=finish, part=part)
    assert [feature.finish for feature in scene.part_with_finishes().features] == [names[1]]
    left = Zone(finish="bare", box_mm=((-60, -50, -9), (18, 50, 9)))
    right = Zone(finish="bare", box_mm=((18, -50, -9), (60, 50, 9)))
    finishes = [
        changed(scene, zones=(zone,)).part_with_finishes().features[0].finish
        for zone in (left, right)
    ]
    assert finishes == ["bare", names[1]]  # the feature is at x = 10
    away = changed(scene, part=Part(name="box", features=(feature_at((40, 30, 400)),)))
    assert away.part_with_finishes().features[0].finish == ""


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"vertices": np.zeros((0, 3))}, r"vertices must have the shape \(n, 3\)"),
        ({"faces": np.zeros((4, 4))}, r"faces must have the shape \(n, 3\)"),
        ({"vertices": np.full((8, 3), np.nan)}, "every vertex must be finite"),
        ({"faces": np.full((12, 3), 8)}, "faces must number vertices from 0 to 7, got 8 to 8"),
        ({"face_finish": np.zeros(3)}, "one entry for each of 12 faces"),
        ({"face_finish": np.full(12, 4)}, "must be one of 0 bare, 1 primer, 2 paint, 3 brushed"),
        ({"n_obstacle_faces": 12}, "must leave some of 12 triangles to the part, got 12"),
        ({"crease_deg": 91.0}, "crease_deg must be from 0 to 90, got 91"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(box, arrays, message):
    with pytest.raises(InputError, match=message):
        changed(box, **arrays)


def test_shading_follows_the_crease():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=30.0)
    on = feature_at((0, 0, -30))
    facets = scene_of(ball, on, crease_deg=1.0).corner_normals()
    np.testing.assert_allclose(facets, np.repeat(ball.face_normals[:, None], 3, 1), atol=1e-6)
    assert np.abs(scene_of(ball, on).corner_normals() - facets).max() > 0.1


# -- features on the surface ---------------------------------------------------------------------


def test_any_surface_will_do(box):
    turned = box.faces.copy()
    turned[::2] = turned[::2, ::-1]
    doubled = np.concatenate([box.faces, box.faces])
    for scene in (
        box,
        changed(box, faces=turned),
        changed(box, faces=box.faces[:, ::-1]),
        changed(box, faces=doubled, face_finish=np.zeros(24)),
        scene_of(sheet(100.0, -1.0), feature_at((40, 30, -1))),
    ):
        assert check_scene(scene) is scene


@pytest.mark.parametrize("x_mm", [0.0, 3000.0, 4999.0])
def test_a_feature_in_the_middle_of_a_large_triangle_lies_on_it(x_mm):
    check_scene(scene_of(sheet(10_000.0), feature_at((x_mm, -2000, 0), "hole", 5.0)))


@pytest.mark.parametrize(
    ("feature", "least_mm", "most_mm"),
    [
        # h / 2 = 10 mm to either side of a ring; a cap's ring lies 0.854 radii above the centre
        (feature_at((0, 0, 0), "hole", 8.0), -10, 10),
        (feature_at((0, 0, 0)), -10, 10),
        (feature_at((0, 0, 0), "slot", 4.0, length_mm=60.0, width_mm=8.0), -10, 10),
        (feature_at((0, 0, 0), "pocket", 2.0, length_mm=60.0, width_mm=30.0), -10, 10),
        (feature_at((0, 0, 0), "sphere", 20.0), -17.07 - 12.93, -17.07 + 12.93),
    ],
    ids=lambda value: getattr(value, "kind", None),
)
def test_the_measured_region_must_hold_some_of_the_surface(feature, least_mm, most_mm):
    for z_mm in (least_mm + 0.1, most_mm - 0.1):
        check_scene(scene_of(sheet(1000.0, z_mm), feature))
    for z_mm in (least_mm - 0.1, most_mm + 0.1):
        with pytest.raises(FeatureError, match="none of which is in its measured region"):
            check_scene(scene_of(sheet(1000.0, z_mm), feature))


def test_a_long_slot_lies_where_its_ends_are():
    slot = feature_at((0, 0, 0), "slot", 4.0, length_mm=200.0, width_mm=8.0)
    end = sheet(10.0)
    check_scene(scene_of(end.apply_translation((96 + 8, 0, 0)), slot))
    with pytest.raises(FeatureError):
        check_scene(scene_of(end.apply_translation((30, 0, 0)), slot))


def test_a_feature_a_metre_off_is_refused(box):
    off = dataclasses.replace(box.part, features=(feature_at((1050.0, 0, 0)),))
    with pytest.raises(FeatureError) as caught:
        check_scene(changed(box, part=off))
    message = str(caught.value)
    assert "feature 'f1' at (1050, 0, 0) mm lies 1000 mm from the nearest surface" in message
    assert "part 'box'" in message
    assert "reaches from (-50, -40, -1) to (50, 40, 1) mm" in message
    assert "check that mesh and features have the same frame and unit" in message


def test_an_obstacle_is_not_the_part(box):
    near = sheet(50.0).apply_translation((500, 0, 0))
    both = trimesh.util.concatenate([trimesh.Trimesh(box.vertices, box.faces), near])
    clamped = feature_at((500, 0, 0))
    check_scene(scene_of(both, clamped))
    with pytest.raises(FeatureError, match="lies 450 mm from the nearest surface"):
        check_scene(scene_of(both, clamped, n_obstacle_faces=2))


@pytest.mark.parametrize("wrong", UNITS_MM)
@pytest.mark.parametrize("right", UNITS_MM)
def test_a_mesh_in_another_unit_is_noticed(right, wrong):
    block = trimesh.creation.box(extents=(100, 80, 60))
    block.apply_scale(UNITS_MM[wrong] / UNITS_MM[right])
    scaled = scene_of(block, feature_at((40, 30, -30), "hole", 2.0))
    if right == wrong:
        check_scene(scaled, wrong)
    else:
        expected = f'with a mesh in {right} instead of {wrong} every .* unit = "{right}"'
        with pytest.raises(FeatureError, match=expected):
            check_scene(scaled, wrong)


numbers = st.floats(-100, 100)
point = st.tuples(numbers, numbers, numbers)


@settings(deadline=None)  # the first call compiles
@given(point, point, point, point)
def test_the_distance_to_a_triangle_is_that_of_its_nearest_point(p, a, b, c):
    p, a, b, c = (np.array(each) for each in (p, a, b, c))
    distance = np.sqrt(_squared_distance(p, a, b, c))
    s, t = np.meshgrid(*[np.linspace(0, 1, 60)] * 2)
    inside = s + t <= 1
    some = a + np.multiply.outer(s[inside], b - a) + np.multiply.outer(t[inside], c - a)
    nearest = np.linalg.norm(some - p, axis=1).min()
    step = max(np.linalg.norm(b - a), np.linalg.norm(c - a)) / 59
    assert distance <= nearest + 1e-6
    assert nearest <= distance + 1.5 * step + 1e-6

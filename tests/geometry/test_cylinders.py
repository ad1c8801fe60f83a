"""Hollow cylinders: which points are inside, and which pixels their ring covers."""

from functools import cache

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from exposight.errors import CloudError, FeatureError
from exposight.geometry import (
    HollowCylinder,
    PinholeCamera,
    PixelBox,
    RigidTransform,
    count_points_inside,
    pixel_boxes,
    ring_pixels,
)

LAW = settings(max_examples=60, deadline=None)

BORDER_MM = 1e-4
"""Points nearer to a border than this are not asked about: float32 at 1 m resolves 6e-5 mm."""

CIRCLE = HollowCylinder(inner_mm=13.0, outer_mm=15.0, height_mm=20.0)
FULL = HollowCylinder(inner_mm=0.0, outer_mm=12.0, height_mm=20.0)
SLOT = HollowCylinder(inner_mm=8.0, outer_mm=10.0, height_mm=20.0, core_half_size_mm=(15.0, 0.0))
POCKET = HollowCylinder(
    inner_mm=5.0, outer_mm=9.0, height_mm=20.0, core_half_size_mm=(14.0, 6.0), plane_z_mm=2.5
)
CYLINDERS = {"circle": CIRCLE, "full": FULL, "slot": SLOT, "pocket": POCKET}
every_cylinder = pytest.mark.parametrize("cylinder", CYLINDERS.values(), ids=CYLINDERS.keys())
any_cylinder = st.sampled_from(list(CYLINDERS.values()))

LENSES = {
    "pinhole": (),
    "barrel": (-0.31, 0.14, -0.0007, 0.0011, -0.03),
    "pincushion": (0.45, 0.3, 0.002, -0.001),
    "tilted": (-0.2, 0.05, 0.001, 0.001, 0, 0, 0, 0, 0.004, 0, -0.003, 0, 0.05, -0.08),
}
every_lens = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())


def ring_of(cylinder, camera, camera_from_feature):
    """The pixels of one ring."""
    return ring_pixels([cylinder], camera, [camera_from_feature])[0]


def points_inside(cylinder, points, camera_from_feature):
    """The number of points in one cylinder."""
    return int(count_points_inside([cylinder], points, [camera_from_feature])[0])


def contains(cylinder, points):
    """Whether each point counts, every one with a box of its own."""
    points = np.asarray(points, dtype=np.float32).reshape(-1, 3)
    n = len(points)
    boxes = [PixelBox(top=0, bottom=1, left=i, right=i + 1) for i in range(n)]
    return count_points_inside([cylinder] * n, points, [RigidTransform()] * n, boxes) > 0


def inside_by_definition(cylinder, points):
    """Eq. 4 in numpy, with radii from the core."""
    radius = distance_to_core_mm(cylinder, points[:, :2])
    inside = (cylinder.inner_mm <= radius) & (radius <= cylinder.outer_mm)
    return inside & (np.abs(points[:, 2] - cylinder.plane_z_mm) <= cylinder.height_mm / 2)


def camera_with(lens, **changes):
    sizes = {"width": 320, "height": 240, "fx": 400.0, "fy": 410.0, "cx": 158.3, "cy": 121.6}
    return PinholeCamera(**(sizes | changes), distortion=lens)


def pose(x_mm, y_mm, z_mm, w_deg=0.0, p_deg=0.0, r_deg=0.0):
    return RigidTransform.from_fanuc_wpr([x_mm, y_mm, z_mm], w_deg, p_deg, r_deg)


POSES = {
    "facing": pose(3.1, -2.2, 300.0),
    "tilted": pose(-40.0, 25.0, 280.0, 30.0, -25.0, 70.0),
    "steep": pose(10.0, 5.0, 260.0, 5.0, 84.0, 10.0),
    "partly outside": pose(115.0, -78.0, 290.0, 10.0, 5.0, 33.0),
    "tiny": pose(20.0, 10.0, 4000.0, 12.0, 8.0, -20.0),
}
every_pose = pytest.mark.parametrize("camera_from_feature", POSES.values(), ids=POSES.keys())


def distance_to_core_mm(cylinder, xy):
    half_size = np.array(cylinder.core_half_size_mm)
    return np.linalg.norm(xy - np.clip(xy, -half_size, half_size), axis=1)


def margin_mm(cylinder, points):
    """Distance of each point to the nearest of the surfaces that bound the region."""
    radius = distance_to_core_mm(cylinder, points[:, :2])
    along = np.abs(points[:, 2] - cylinder.plane_z_mm)
    bounds = [
        radius - cylinder.inner_mm,
        radius - cylinder.outer_mm,
        along - cylinder.height_mm / 2,
    ]
    return np.abs(bounds).min(axis=0)


@cache
def rays_by_opencv(camera):
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1).astype(np.float64)
    until_exact = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    return cv2.undistortPoints(
        pixels[:, None], camera.matrix, np.array(camera.distortion), criteria=until_exact
    )[:, 0]


def covered_by_brute_force(cylinder, camera, camera_from_feature):
    """Masks of all pixels whose ray meets the ring, and of those too near its border to tell.

    Where a ray t·(x, y, 1) meets the plane o + a·x + b·y, (a, b, 1) / t solves a linear system.
    """
    origin = camera_from_feature.apply([0, 0, cylinder.plane_z_mm])
    camera_from_plane = np.column_stack([camera_from_feature.rotation[:, :2], origin])
    rays = cv2.convertPointsToHomogeneous(rays_by_opencv(camera))[:, 0]
    a, b, one_over_t = np.linalg.solve(camera_from_plane, rays.T)
    plane_mm = np.column_stack([a, b]) / one_over_t[:, None]
    radius = distance_to_core_mm(cylinder, plane_mm)
    covered = (one_over_t > 0) & (radius >= cylinder.inner_mm) & (radius <= cylinder.outer_mm)
    doubtful = np.minimum(np.abs(radius - cylinder.inner_mm), np.abs(radius - cylinder.outer_mm))
    shape = (camera.height, camera.width)
    return covered.reshape(shape), (doubtful < BORDER_MM).reshape(shape)


def mask(camera, rows, columns):
    covered = np.zeros((camera.height, camera.width), dtype=bool)
    covered[rows, columns] = True
    return covered


# -- points inside ------------------------------------------------------------------------------


def test_points_inside_are_those_in_a_mesh_of_the_hollow_cylinder():
    sections = 720
    mesh = trimesh.creation.annulus(13.0, 15.0, 20.0, sections=sections)
    points = np.random.default_rng(3).uniform(-17, 17, (4000, 3))
    sagitta_mm = 15.0 * (1 - np.cos(np.pi / sections))
    clear = margin_mm(CIRCLE, points) > 2 * sagitta_mm
    np.testing.assert_array_equal(contains(CIRCLE, points[clear]), mesh.contains(points[clear]))


@every_cylinder
def test_what_is_inside_goes_by_the_distance_to_the_core(cylinder):
    points = np.random.default_rng(4).uniform([-32, -24, -14], [32, 24, 14], (3000, 3))
    points = points[margin_mm(cylinder, points) > BORDER_MM]
    expected = inside_by_definition(cylinder, points)
    np.testing.assert_array_equal(contains(cylinder, points), expected)


def test_a_pocket_is_bounded_by_opencvs_distance_to_a_rectangle():
    corners = np.array([[-14, -6], [14, -6], [14, 6], [-14, 6]], dtype=np.float32)
    xy = np.random.default_rng(8).uniform([-26, -18], [26, 18], (1000, 2))
    distance = np.array([-cv2.pointPolygonTest(corners, point, True) for point in xy])
    clear = np.minimum(np.abs(distance - 5.0), np.abs(distance - 9.0)) > BORDER_MM
    expected = (distance >= 5.0) & (distance <= 9.0)
    inside = contains(POCKET, np.column_stack([xy, np.zeros(1000)]))
    np.testing.assert_array_equal(inside[clear], expected[clear])


@pytest.mark.parametrize(
    ("point", "inside"),
    [
        ((13, 0, 0), True),
        ((0, -15, 0), True),
        ((14, 0, 10), True),
        ((14, 0, -10), True),
        ((12.999, 0, 0), False),
        ((15.001, 0, 0), False),
        ((14, 0, 10.001), False),
        ((0, 0, 0), False),
    ],
)
def test_borders_belong_to_the_region(point, inside):
    assert contains(CIRCLE, point) == inside


def test_the_rings_plane_may_lie_off_the_features_origin():
    assert contains(POCKET, [[20, 0, 12.4], [20, 0, -7.4], [20, 0, -7.6]]).tolist() == [1, 1, 0]


@every_cylinder
def test_nothing_inside_lies_beyond_the_bounding_radius(cylinder):
    points = np.random.default_rng(5).uniform(-40, 40, (5000, 3))
    inside = points[contains(cylinder, points)]
    assert np.linalg.norm(inside, axis=1).max() <= cylinder.bounding_radius_mm


# -- counting points ----------------------------------------------------------------------------

coordinates = st.floats(-40.0, 40.0, width=32)
clouds = st_numpy.arrays(
    np.float32, st.tuples(st.integers(0, 40), st.just(3)), elements=coordinates
)


@LAW
@given(any_cylinder, clouds, st.sampled_from(list(POSES.values())))
def test_counting_agrees_with_the_definition(cylinder, near_feature, camera_from_feature):
    points = camera_from_feature.apply(near_feature).astype(np.float32)
    local = camera_from_feature.inverse().apply(points)
    if len(local):
        clear = margin_mm(cylinder, local) > BORDER_MM
        points, local = points[clear], local[clear]
    expected = int(inside_by_definition(cylinder, local).sum())
    assert points_inside(cylinder, points, camera_from_feature) == expected


@LAW
@given(any_cylinder, clouds, st.integers(0, 2), st.sampled_from(list(POSES.values())))
def test_points_with_a_missing_coordinate_never_count(cylinder, cloud, axis, camera_from_feature):
    points = camera_from_feature.apply(cloud).astype(np.float32)
    points[:, axis] = np.nan
    assert points_inside(cylinder, points, camera_from_feature) == 0


def test_an_organised_cloud_counts_as_its_points_do():
    points = np.random.default_rng(6).uniform(-20, 20, (24, 3)).astype(np.float32)
    listed = points_inside(FULL, points, RigidTransform())
    assert listed > 0
    assert points_inside(FULL, points.reshape(4, 6, 3), RigidTransform()) == listed


def test_a_window_of_a_larger_cloud_can_be_counted():
    cloud = np.zeros((10, 10, 3), dtype=np.float32)
    assert points_inside(FULL, cloud[2:5, 3:9], RigidTransform()) == 18


@pytest.mark.parametrize("shape", [(5, 2), (3,), (2, 5, 4), (1, 2, 5, 3)])
def test_a_cloud_of_another_shape_is_refused(shape):
    with pytest.raises(CloudError, match=r"\(rows, columns, 3\) or \(n, 3\), got shape"):
        points_inside(FULL, np.zeros(shape, dtype=np.float32), RigidTransform())


# -- the outline --------------------------------------------------------------------------------


@every_cylinder
def test_the_outline_goes_closely_round_the_border(cylinder):
    polygon = cylinder.outline()
    radius = distance_to_core_mm(cylinder, polygon[:, :2])
    assert radius.min() >= cylinder.outer_mm * (1 - 1e-12)
    assert radius.max() <= cylinder.outer_mm * 1.0005
    np.testing.assert_array_equal(polygon[:, 2], cylinder.plane_z_mm)


@every_cylinder
def test_the_outlines_area_is_that_of_the_rounded_rectangle(cylinder):
    x, y, _ = cylinder.outline().T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))  # shoelace; positive: one turn
    a, b = np.multiply(2, cylinder.core_half_size_mm)
    r = cylinder.outer_mm
    exact = a * b + 2 * (a + b) * r + np.pi * r**2
    assert exact < area < 1.0003 * exact


def test_an_outline_may_lie_at_another_height():
    np.testing.assert_array_equal(SLOT.outline(z_mm=-10.0)[:, 2], -10.0)


# -- the ring's pixels --------------------------------------------------------------------------


@every_cylinder
@every_lens
@every_pose
def test_ring_pixels_agree_with_brute_force(cylinder, lens, camera_from_feature):
    camera = camera_with(lens)
    covered = mask(camera, *ring_of(cylinder, camera, camera_from_feature))
    expected, doubtful = covered_by_brute_force(cylinder, camera, camera_from_feature)
    np.testing.assert_array_equal(covered | doubtful, expected | doubtful)


def test_pixels_come_in_row_major_order_without_doubles():
    rows, columns = ring_of(CIRCLE, camera_with(LENSES["barrel"]), POSES["tilted"])
    position = rows * 320 + columns
    assert len(position) > 100
    assert (np.diff(position) > 0).all()


@pytest.mark.parametrize(("hole_radius_mm", "n"), [(3.0, 400), (8.0, 200), (30.0, 50)])
def test_facing_rings_cover_their_projected_area_on_average(hole_radius_mm, n):
    ring = HollowCylinder(inner_mm=hole_radius_mm + 3, outer_mm=hole_radius_mm + 5, height_mm=20.0)
    camera = camera_with((), fx=800.0, fy=820.0)
    offsets_mm = np.random.default_rng(7).uniform(-10, 10, (n, 2))
    poses = [pose(x, y, 600.0) for x, y in offsets_mm]
    counts = [rows.size for rows, _ in ring_pixels([ring] * len(poses), camera, poses)]
    scale = 800.0 * 820.0 / 600.0**2
    area_px = np.pi * (ring.outer_mm**2 - ring.inner_mm**2) * scale
    # Four standard errors: the lattice alone makes a single count vary.
    assert np.mean(counts) == pytest.approx(area_px, abs=4 * np.std(counts) / np.sqrt(n))
    assert np.mean(counts) == pytest.approx(area_px, rel=0.005)


@pytest.mark.parametrize("tilt_deg", [20.0, 45.0, 60.0])
def test_far_tilted_rings_shrink_by_the_cosine(tilt_deg):
    camera = camera_with((), fx=4e5, fy=4e5)  # from so far away perspective is gone
    facing = ring_of(CIRCLE, camera, pose(0, 0, 60000.0))[0].size
    tilted = ring_of(CIRCLE, camera, pose(0, 0, 60000.0, p_deg=tilt_deg))[0].size
    assert tilted / facing == pytest.approx(np.cos(np.radians(tilt_deg)), rel=0.01)


@LAW
@given(st.floats(-180.0, 180.0))
def test_a_circular_ring_does_not_see_turns_about_its_axis(angle_deg):
    camera, camera_from_feature = camera_with(LENSES["barrel"]), POSES["tilted"]
    turned = camera_from_feature @ pose(0, 0, 0, r_deg=angle_deg)
    before = ring_of(CIRCLE, camera, camera_from_feature)
    np.testing.assert_array_equal(ring_of(CIRCLE, camera, turned), before)


def test_a_slot_turned_by_half_a_turn_is_the_same_slot():
    camera, camera_from_feature = camera_with(LENSES["barrel"]), POSES["tilted"]
    turned = camera_from_feature @ pose(0, 0, 0, r_deg=180.0)
    before = ring_of(SLOT, camera, camera_from_feature)
    np.testing.assert_array_equal(ring_of(SLOT, camera, turned), before)


def test_a_slot_turned_by_a_quarter_is_a_slot_along_y():
    along_y = HollowCylinder(
        inner_mm=8.0, outer_mm=10.0, height_mm=20.0, core_half_size_mm=(0.0, 15.0)
    )
    camera, camera_from_feature = camera_with(LENSES["barrel"]), POSES["tilted"]
    turned = camera_from_feature @ pose(0, 0, 0, r_deg=90.0)
    expected = ring_of(along_y, camera, camera_from_feature)
    np.testing.assert_array_equal(ring_of(SLOT, camera, turned), expected)


def test_the_ring_lies_in_its_plane():
    raised = HollowCylinder(inner_mm=13.0, outer_mm=15.0, height_mm=20.0, plane_z_mm=7.0)
    camera, camera_from_feature = camera_with(LENSES["barrel"]), POSES["tilted"]
    moved = camera_from_feature @ pose(0, 0, 7.0)
    expected = ring_of(CIRCLE, camera, moved)
    np.testing.assert_array_equal(ring_of(raised, camera, camera_from_feature), expected)


@every_cylinder
@every_lens
def test_a_perfect_plate_gives_as_many_points_as_pixels(cylinder, lens):
    camera, camera_from_feature = camera_with(lens), POSES["tilted"]
    normal = camera_from_feature.z_axis
    rays = np.concatenate([camera.rays(), np.ones((camera.height, camera.width, 1))], axis=-1)
    plane = normal @ camera_from_feature.apply([0, 0, cylinder.plane_z_mm])
    cloud = (rays * (plane / (rays @ normal))[..., None]).astype(np.float32)
    n_pixels = ring_of(cylinder, camera, camera_from_feature)[0].size
    assert n_pixels > 200
    # float32 may move a point in a thousand across a border.
    n_points = points_inside(cylinder, cloud, camera_from_feature)
    assert n_points == pytest.approx(n_pixels, rel=1e-3)


# -- rings at the edges -------------------------------------------------------------------------


@every_lens
def test_a_ring_partly_outside_is_cut_at_the_frame(lens):
    camera_from_feature = POSES["partly outside"]
    small = camera_with(lens)
    wide = camera_with(lens, width=520, height=440, cx=small.cx + 100, cy=small.cy + 100)
    cut = mask(small, *ring_of(CIRCLE, small, camera_from_feature))
    whole = mask(wide, *ring_of(CIRCLE, wide, camera_from_feature))
    assert 0 < cut.sum() < whole.sum()
    np.testing.assert_array_equal(cut, whole[100:340, 100:420])


@every_lens
@pytest.mark.parametrize(
    "camera_from_feature",
    [pose(500, 0, 300), pose(0, -500, 300), pose(0, 0, -300), pose(0, 0, 0)],
    ids=["right of the frame", "above the frame", "behind", "at the camera"],
)
def test_a_ring_that_is_not_seen_has_no_pixels(lens, camera_from_feature):
    rows, columns = ring_of(CIRCLE, camera_with(lens), camera_from_feature)
    assert rows.size == columns.size == 0
    assert rows.dtype == columns.dtype == np.int64


@every_cylinder
@pytest.mark.parametrize("x_mm", [0.0, 5.0, -5.0])
def test_a_region_seen_edge_on_has_no_pixels_on_parallel_rays(cylinder, x_mm):
    edge_on = RigidTransform(
        rotation=[[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        translation_mm=[x_mm - cylinder.plane_z_mm, 0, 300],
    )
    camera = camera_with((), cx=158.0, cy=121.0)  # its column 158 runs parallel to the plane
    _, columns = ring_of(cylinder, camera, edge_on)
    assert 158 not in columns


@every_lens
@pytest.mark.parametrize("p_deg", [80.0, 89.0])
def test_of_a_ring_partly_behind_the_camera_the_rest_is_seen(lens, p_deg):
    camera = camera_with(lens)
    large = HollowCylinder(inner_mm=100.0, outer_mm=300.0, height_mm=20.0)
    camera_from_feature = pose(-30.0, 0.0, 100.0, p_deg=p_deg)
    assert (camera_from_feature.apply(large.outline())[:, 2] < 0).any()
    covered = mask(camera, *ring_of(large, camera, camera_from_feature))
    expected, doubtful = covered_by_brute_force(large, camera, camera_from_feature)
    assert covered.sum() > 100
    np.testing.assert_array_equal(covered | doubtful, expected | doubtful)


def test_a_region_whose_outline_the_lens_does_not_reach_fills_the_frame():
    plate = HollowCylinder(inner_mm=0.0, outer_mm=5000.0, height_mm=20.0)
    camera = camera_with((-0.3, 0, 0, 0))
    assert ring_of(plate, camera, pose(0, 0, 300.0))[0].size == camera.width * camera.height


def test_the_sides_of_a_large_pocket_bow_out_of_their_corners_box():
    pocket = HollowCylinder(
        inner_mm=1.0, outer_mm=3.0, height_mm=20.0, core_half_size_mm=(190.0, 120.0)
    )
    camera = camera_with((-0.3, 0, 0, 0), width=640, height=480, cx=320.0, cy=240.0)
    camera_from_feature = pose(0, 0, 300.0)
    covered = mask(camera, *ring_of(pocket, camera, camera_from_feature))
    expected, doubtful = covered_by_brute_force(pocket, camera, camera_from_feature)
    np.testing.assert_array_equal(covered | doubtful, expected | doubtful)


# -- boxes of pixels ----------------------------------------------------------------------------


def boxes_of(pixels, margin_px):
    """The box of points that project to given pixels, at 1 m."""
    camera = camera_with(())
    points = camera.back_project(pixels, 1000.0)
    return pixel_boxes(points[None], camera, margin_px)[0]


def test_a_pixel_box_holds_all_positions_and_a_margin():
    box = boxes_of([[10.2, 20.0001], [14.0001, 25.7]], margin_px=2)
    assert box == PixelBox(top=18, bottom=29, left=8, right=18)
    assert not box.empty


def test_a_pixel_box_is_cut_at_the_frame_also_far_away():
    box = boxes_of([[-1e15, 5.1], [1e15, 1e15]], margin_px=1)
    assert box == PixelBox(top=4, bottom=240, left=0, right=320)


@pytest.mark.parametrize("position", [[-9.0, 5.0], [400.0, 5.0], [5.0, -1e15], [5.0, 900.0]])
def test_a_pixel_box_outside_the_frame_is_empty(position):
    assert boxes_of([position], margin_px=1).empty


def test_what_projects_only_in_part_is_searched_for_everywhere():
    outline = np.array([[[0.0, 0.0, 500.0], [0.0, 0.0, -1.0]]])
    (box,) = pixel_boxes(outline, camera_with(()), margin_px=1)
    assert box == PixelBox(top=0, bottom=240, left=0, right=320)


def test_many_features_at_once_give_what_each_alone_gives():
    camera = camera_with(LENSES["barrel"])
    rings = [CIRCLE, SLOT, CIRCLE]
    poses = [pose(0, 0, 600.0), pose(20, -10, 650.0, w_deg=12.0), pose(5000, 0, 600.0)]
    together = ring_pixels(rings, camera, poses)
    for (rows, columns), ring, where in zip(together, rings, poses, strict=True):
        np.testing.assert_array_equal((rows, columns), ring_of(ring, camera, where))
    assert ring_pixels([], camera, []) == []


# -- bad sizes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inner_mm": -1.0}, "needs 0 ≤ inner < outer and a height above 0, got inner -1"),
        ({"inner_mm": 15.0}, "needs 0 ≤ inner < outer .* got inner 15, outer 15, height 20 mm"),
        ({"outer_mm": 3.0}, "needs 0 ≤ inner < outer .* outer 3"),
        ({"height_mm": 0.0}, "a height above 0, got .* height 0 mm"),
        ({"height_mm": np.nan}, "sizes of a hollow cylinder must be finite"),
        ({"outer_mm": np.inf}, "sizes of a hollow cylinder must be finite"),
        ({"plane_z_mm": np.nan}, "sizes of a hollow cylinder must be finite"),
        ({"core_half_size_mm": (-1.0, 0.0)}, "core's half size must not be negative, got"),
    ],
)
def test_sizes_that_make_no_ring_are_refused(changes, message):
    with pytest.raises(FeatureError, match=message):
        HollowCylinder(**({"inner_mm": 13.0, "outer_mm": 15.0, "height_mm": 20.0} | changes))

"""Form, gaps and rim of rings on plates whose holes are known exactly."""

import numpy as np
import pytest

from exposight.cell import Cloud, Feature
from exposight.geometry import RigidTransform

PITCH_MM = 600.0 / 800.0
"""Size of a pixel on a plate that faces the small sensor at its TCP."""


def punched(camera, pose, holes, *, noise_mm=0.0, sigma_mm=None, without=None):
    """One point of a plate on every pixel's ray, none in holes (x, y, radius)."""
    rays = np.concatenate([camera.rays(), np.ones((camera.height, camera.width, 1))], axis=-1)
    depth = (pose.z_axis @ pose.translation_mm) / (rays @ pose.z_axis)
    on_plate = (rays * depth[..., None] - pose.translation_mm) @ pose.rotation
    rng = np.random.default_rng(5)
    points = rays * (depth + noise_mm * rng.standard_normal(depth.shape))[..., None]
    for x, y, radius in holes:
        points[np.hypot(on_plate[..., 0] - x, on_plate[..., 1] - y) < radius] = np.nan
    if without is not None:
        points[without(on_plate)] = np.nan
    return Cloud(
        points=points, sigma_z_mm=None if sigma_mm is None else np.full(depth.shape, sigma_mm)
    )


@pytest.fixture
def measured(sensor, make_capture, observe, hole):
    def measure(holes, *, pose=None, nominal=20.0, feature=None, cloud=None, **plate):
        pose = pose or RigidTransform(translation_mm=[0, 0, 600.0])
        cloud = cloud or punched(sensor.camera, pose, holes, **plate)
        feature = feature or hole(nominal)
        (row,) = observe(sensor, feature, make_capture(sensor, pose, cloud=cloud))
        return row

    return measure


@pytest.mark.parametrize("tilt", [(0, 0), (25, 0), (-12, 24)])
@pytest.mark.parametrize("noise_mm", [0.0, 0.1])
def test_diameters_have_no_bias_of_a_pixel(measured, hole, tilt, noise_mm):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 600), *tilt, 10.0)
    errors = []
    for i, (x, y) in enumerate(np.random.default_rng(2).uniform(-60, 60, (8, 2))):
        radius = 9.0 + 1.3 * i
        feature = hole(radius, RigidTransform(translation_mm=[x, y, 0.0]))
        row = measured([(x, y, radius)], pose=pose, feature=feature, noise_mm=noise_mm)
        assert row.diameter_mm == pytest.approx(2 * radius + row.diameter_error_mm)
        assert row.centre_error_mm < 0.15 * PITCH_MM
        errors.append(row.diameter_error_mm)
    assert np.abs(errors).max() < 0.2 * PITCH_MM
    assert abs(np.mean(errors)) < 0.05 * PITCH_MM


def test_a_hole_that_is_larger_and_elsewhere_is_measured_as_it_is(measured):
    row = measured([(1.5, -2.0, 21.0)], nominal=20.0)
    assert row.diameter_error_mm == pytest.approx(2.0, abs=0.1)
    assert row.centre_error_mm == pytest.approx(2.5, abs=0.1)


def test_deviations_are_from_the_rings_own_plane(measured):
    pose = RigidTransform.from_fanuc_wpr((0, 0, 600), 5.0, -10.0, 0.0)
    row = measured([(0, 0, 20.0)], pose=pose, noise_mm=0.1)
    across = 0.1 * abs(pose.z_axis[2])  # noise is along z, deviations across the plane
    assert row.plane_std_mm == pytest.approx(across, rel=0.1)
    assert row.form_error_mm == pytest.approx(2 * 1.96 * across, rel=0.1)
    flat = measured([(0, 0, 20.0)], pose=pose)
    assert flat.plane_std_mm < 1e-4
    assert flat.form_error_mm < 1e-3


def test_the_largest_gap_is_where_points_are_missing(measured):
    def sector(on_plate):
        return np.abs(np.degrees(np.arctan2(on_plate[..., 1], on_plate[..., 0])) - 175) < 20

    whole = measured([(0, 0, 20.0)])
    assert whole.largest_gap_deg < np.degrees(2 * PITCH_MM / 20)
    part = measured([(0, 0, 20.0)], without=sector)
    # from 155° to 180° here: beyond, angles go on at −180°
    assert part.largest_gap_deg == pytest.approx(25.0, abs=2.0)
    assert part.diameter_error_mm == pytest.approx(0.0, abs=0.2)
    none = measured([(0, 0, 60.0)])
    assert none.n_points == 0
    assert none.largest_gap_deg == 360.0
    assert none.plane_std_mm is None
    assert none.diameter_mm is None


def test_no_rim_is_made_up(measured, hole):
    assert measured([]).diameter_mm is None  # no hole there
    half = measured([(0, 0, 20.0)], without=lambda on_plate: on_plate[..., 0] > 0)
    assert half.plane_std_mm is not None
    assert half.diameter_mm is None
    square = measured([], without=lambda on_plate: np.abs(on_plate[..., :2]).max(axis=-1) < 20.0)
    assert square.diameter_mm is None
    slot = Feature(
        name="s", kind="slot", part_from_feature=RigidTransform(), radius_mm=20.0,
        length_mm=60.0, width_mm=40.0,
    )  # fmt: skip
    row = measured([(0, 0, 20.0)], feature=slot)
    assert row.plane_std_mm is not None
    assert row.diameter_mm is None


def test_stray_points_in_the_hole_do_not_move_its_rim(measured, sensor):
    cloud = punched(sensor.camera, RigidTransform(translation_mm=[0, 0, 600.0]), [(0, 0, 20.0)])
    full = punched(sensor.camera, RigidTransform(translation_mm=[0, 0, 600.0]), [])
    points = cloud.points.copy()
    stray = np.random.default_rng(0).random(points.shape[:2]) < 0.01
    points[stray] = full.points[stray]
    row = measured([], cloud=Cloud(points=points))
    assert row.diameter_error_mm == pytest.approx(0.0, abs=0.15)


def test_a_list_of_points_is_measured_as_the_organised_cloud_is(measured, sensor):
    pose = RigidTransform.from_fanuc_wpr((3, 2, 610), 12.0, 5.0, 0.0)
    holes = [(0, 0, 20.0)]
    cloud = punched(sensor.camera, pose, holes, noise_mm=0.05, sigma_mm=0.25)
    one = measured(holes, pose=pose, cloud=cloud)
    shuffled = np.random.default_rng(1).permutation(cloud.n_valid)
    listed = Cloud(
        points=cloud.valid_points[shuffled], sigma_z_mm=cloud.sigma_z_mm[cloud.valid][shuffled]
    )
    assert measured(holes, pose=pose, cloud=listed) == one
    assert one.sigma_z_mm == 0.25
    assert measured(holes, pose=pose).sigma_z_mm is None

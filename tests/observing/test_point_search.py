"""Counting the points inside hollow cylinders: every way gives what testing each point gives."""

import numpy as np
import pytest

from exposight.cell import Cloud, Feature, Part
from exposight.geometry import RigidTransform, count_points_inside
from exposight.observing import point_search, view_features

CAMERA_FROM_PART = RigidTransform.from_fanuc_wpr((0, 0, 600), 17, -13, 30)


@pytest.fixture(scope="module")
def sensor(make_sensor):
    return make_sensor(distortion=(-0.1, 0.02, 0.001, 0.0))


@pytest.fixture(scope="module")
def views(sensor, hole):
    """Rings, frames and discs all over the frame, some cut by its border."""
    poses = [
        RigidTransform.from_fanuc_wpr((x, y, 0), 0, 0, x)
        for x in (-230, 0, 95)
        for y in (-150, 0, 60)
    ]
    holes = [hole(4.0 + i, pose, f"h{i}") for i, pose in enumerate(poses)]
    slot = Feature(
        name="s1",
        kind="slot",
        part_from_feature=poses[4],
        radius_mm=6.0,
        length_mm=50.0,
        width_mm=12.0,
    )
    disc = Feature(name="p1", kind="surface_point", part_from_feature=poses[5], radius_mm=15.0)
    part = Part(name="part", features=(*holes, slot, disc))
    return view_features(part, sensor, CAMERA_FROM_PART)


@pytest.fixture(scope="module")
def rough(sensor, plate_cloud):
    """A plate so rough that cylinders of 20 mm height miss points, with a fifth missing."""
    rng = np.random.default_rng(7)
    points = plate_cloud(sensor.camera, CAMERA_FROM_PART).points.astype(np.float64)
    points *= rng.normal(1.0, 0.012, (*points.shape[:2], 1))  # along the pixel's ray
    points[rng.random(points.shape[:2]) < 0.2] = np.nan
    return Cloud(points=points)


def counted_one_by_one(cloud, views):
    """Count feature by feature among all points (Eq. 4)."""
    return [
        int(count_points_inside([v.region], cloud.valid_points, [v.camera_from_feature])[0])
        for v in views
    ]


@pytest.fixture(scope="module")
def expected(rough, views):
    return counted_one_by_one(rough, views)


def shuffled(cloud):
    points = cloud.points.reshape(-1, 3)
    return Cloud(points=np.random.default_rng(3).permutation(points))


def test_an_organised_cloud_is_counted_exactly(sensor, views, rough, expected):
    counts = point_search(rough, sensor.camera).count(views)
    assert counts.tolist() == expected
    assert np.count_nonzero(counts > 100) >= 8


def test_an_unorganised_shuffled_cloud_gives_the_same_counts(sensor, views, rough, expected):
    counts = point_search(shuffled(rough), sensor.camera).count(views)
    assert counts.tolist() == expected


def test_an_organised_cloud_that_does_not_follow_its_pixels_is_counted_exactly(
    sensor, views, rough, expected
):
    """As from a sensor that organises its cloud like another camera's image."""
    turned = Cloud(points=rough.points[::-1, ::-1])
    counts = point_search(turned, sensor.camera).count(views)
    assert counts.tolist() == expected


def test_a_cloud_that_strays_a_few_pixels_is_counted_exactly(sensor, views, rough):
    shifted = Cloud(points=rough.points + np.float32([4.0, 0.0, 0.0]))
    counts = point_search(shifted, sensor.camera).count(views)
    assert counts.tolist() == counted_one_by_one(shifted, views)


@pytest.mark.parametrize("side_px", [1, 3, 15])
def test_a_few_points_that_stray_from_their_pixels_are_counted(
    sensor, views, rough, expected, side_px
):
    """A patch of a ring's points on the pixels of another corner."""
    points = rough.points.copy()
    n = side_px**2
    rows, columns = views[4].rows[:n], views[4].columns[:n]
    points[-side_px:, -side_px:] = points[rows, columns].reshape(side_px, side_px, 3)
    points[rows, columns] = np.nan
    counts = point_search(Cloud(points=points), sensor.camera).count(views)
    assert counts.tolist() == expected


def test_a_cloud_of_another_size_than_the_image_is_counted_exactly(sensor, views, rough):
    smaller = Cloud(points=rough.points[:, ::2])
    counts = point_search(smaller, sensor.camera).count(views)
    assert counts.tolist() == counted_one_by_one(smaller, views)


@pytest.mark.parametrize("ratio", [2, 4])
@pytest.mark.parametrize("means", [False, True])
def test_a_coarser_grid_counts_its_own_pixels(sensor, views, plate_cloud, ratio, means):
    """A whole cloud has p_norm 1 whatever its resolution, but for the pixels at rings' edges."""
    plane = plate_cloud(sensor.camera, CAMERA_FROM_PART)
    views = [view for view in views if view.n_pixels]
    points = plane.points
    rows, columns = (size // ratio * ratio for size in points.shape[:2])
    points = points[:rows, :columns]
    if means:
        points = points.reshape(rows // ratio, ratio, columns // ratio, ratio, 3).mean(axis=(1, 3))
    else:
        points = points[::ratio, ::ratio]
    search = point_search(Cloud(points=points), sensor.camera)
    counts, pixels = search.count(views), search.pixels(views)
    whole = point_search(plane, sensor.camera)
    assert whole.pixels(views).tolist() == [view.n_pixels for view in views]
    assert pixels.sum() == pytest.approx(whole.pixels(views).sum() / ratio**2, rel=0.1)
    assert counts.sum() == pytest.approx(pixels.sum(), rel=0.02)


@pytest.mark.parametrize("organised", [True, False])
def test_a_cloud_without_points_counts_none(sensor, views, organised):
    shape = (sensor.camera.height, sensor.camera.width, 3) if organised else (10, 3)
    search = point_search(Cloud(points=np.full(shape, np.nan)), sensor.camera)
    assert search.count(views).tolist() == [0] * len(views)


@pytest.mark.parametrize("organised", [True, False])
def test_no_feature_no_count(sensor, rough, organised):
    cloud = rough if organised else shuffled(rough)
    assert point_search(cloud, sensor.camera).count([]).tolist() == []

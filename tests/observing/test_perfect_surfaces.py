"""A perfect cloud gives p_norm = 1, whatever the feature, the pose and the sensor."""

import numpy as np
import pytest

from exposight.cell import Cloud, Feature, sensor_preset
from exposight.geometry import RigidTransform

PLATE_TOLERANCE = 0.001
"""Points are counted where pixels are counted; only float32 moves one across a border."""

SPHERE_TOLERANCE = 0.02
"""A sphere's cap is no plane: its pixels are counted at its mean height."""

RADII_MM = (3.0, 5.0, 8.0, 13.0, 20.0, 30.0)
CENTRES_MM = ((-90, -60), (0, -55), (95, -60), (-90, 60), (0, 50), (95, 55))

POSES = (
    (0.0, 0.0, 0.0, 0.0),
    (10.0, 0.0, 12.0, -80.0),
    (0.0, -20.0, 45.0, 60.0),
    (30.0, 0.0, -30.0, 20.0),
    (-20.0, 22.0, 70.0, -30.0),
)
"""w, p, r in degrees, up to 30° of tilt, and the distance from the TCP in mm."""


@pytest.mark.parametrize(("w", "p", "r", "z_mm"), POSES)
@pytest.mark.parametrize("preset", ["comet-pro-ae", "rc-visard-65"])
def test_rings_on_a_flat_plate(make_capture, observe, hole, preset, w, p, r, z_mm):
    sensor = sensor_preset(preset)
    tcp_from_part = RigidTransform.from_fanuc_wpr((0, 0, z_mm), w, p, r)
    features = tuple(
        hole(radius, RigidTransform(translation_mm=[x, y, 0]), f"r{radius:g}")
        for radius, (x, y) in zip(RADII_MM, CENTRES_MM, strict=True)
    )
    rows = observe(sensor, features, make_capture(sensor, sensor.camera_from_tcp @ tcp_from_part))
    assert [row.visibility for row in rows] == ["visible"] * len(RADII_MM)
    assert [row.p_norm for row in rows] == pytest.approx([1.0] * 6, abs=PLATE_TOLERANCE)


@pytest.mark.parametrize(
    "distortion",
    [(-0.35, 0.12, 0.0, 0.0), (0.4, 0.0, 0.0, 0.0), (-0.2, 0.05, 0.01, -0.008, 0.01)],
    ids=["barrel", "pincushion", "tangential"],
)
def test_rings_through_a_strongly_distorting_lens(
    make_sensor, make_capture, observe, hole, distortion
):
    sensor = make_sensor(distortion=distortion)
    camera_from_part = RigidTransform.from_fanuc_wpr((0, 0, 600), 15, -12, 0)
    features = tuple(
        hole(12.0, RigidTransform(translation_mm=[x, y, 0]), f"{x}/{y}")
        for x in (-150, 0, 150)
        for y in (-100, 0, 100)
    )
    rows = observe(sensor, features, make_capture(sensor, camera_from_part))
    assert [row.visibility for row in rows] == ["visible"] * 9
    assert [row.p_norm for row in rows] == pytest.approx([1.0] * 9, abs=PLATE_TOLERANCE)


@pytest.mark.parametrize(
    "size",
    [
        {"kind": "slot", "radius_mm": 6.0, "length_mm": 40.0, "width_mm": 12.0},
        {"kind": "pocket", "radius_mm": 4.0, "length_mm": 40.0, "width_mm": 25.0},
        {"kind": "pocket", "radius_mm": 0.0, "length_mm": 30.0, "width_mm": 30.0},
        {"kind": "surface_point", "radius_mm": 10.0},
    ],
    ids=["slot", "pocket", "sharp pocket", "surface point"],
)
def test_other_features_on_a_flat_plate(sensor, make_capture, observe, size):
    camera_from_part = RigidTransform.from_fanuc_wpr((0, 0, 600), 12, -18, 25)
    pose = RigidTransform.from_fanuc_wpr((20, -15, 0), 0, 0, 33)
    feature = Feature(name="f1", part_from_feature=pose, **size)
    (row,) = observe(sensor, feature, make_capture(sensor, camera_from_part))
    assert row.p_norm == pytest.approx(1.0, abs=PLATE_TOLERANCE)


def sphere_cloud(camera, centre_mm, radius_mm):
    """One point on the near side of a sphere for every pixel that sees it."""
    rays = camera.rays()
    rays = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
    half_b, a = rays @ centre_mm, (rays**2).sum(axis=-1)
    discriminant = half_b**2 - a * (centre_mm @ centre_mm - radius_mm**2)
    root = np.sqrt(discriminant, where=discriminant >= 0, out=np.full(a.shape, np.nan))
    return Cloud(points=rays * ((half_b - root) / a)[..., None])


@pytest.mark.parametrize("radius_mm", [10.0, 15.0, 25.0])
def test_spheres(sensor, make_capture, observe, radius_mm):
    camera_from_part = RigidTransform.from_fanuc_wpr((10, -20, 600), 8, -5, 0)
    feature = Feature(
        name="s1", kind="sphere", part_from_feature=RigidTransform(), radius_mm=radius_mm
    )
    cloud = sphere_cloud(sensor.camera, camera_from_part.translation_mm, radius_mm)
    (row,) = observe(sensor, feature, make_capture(sensor, camera_from_part, cloud=cloud))
    assert row.p_norm == pytest.approx(1.0, abs=SPHERE_TOLERANCE)


def test_pixels_are_the_rings_area_in_pixels(sensor, facing, make_capture, observe, hole):
    (row,) = observe(sensor, hole(20.0), make_capture(sensor, facing))
    area_px = np.pi * (25.0**2 - 23.0**2) * (sensor.camera.fx / 600.0) ** 2
    # a border of 400 px length, whose pixels fall in or out at random: 3 standard deviations
    assert row.n_pixels == pytest.approx(area_px, rel=0.05)

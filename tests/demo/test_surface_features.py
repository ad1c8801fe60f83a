import numpy as np
import pytest

from exposight.cell import Cloud, Part, sensor_preset
from exposight.demo import PlacementRules, place_features
from exposight.errors import CloudError
from exposight.geometry import RigidTransform
from exposight.observing import Visibility, view_features

# A fitted normal differs from the plate's by float32 rounding of the points, at most.
ANGLE_TOLERANCE_DEG = 0.01


def tilted_plate(sensor, w_deg):
    pose = sensor.camera_from_tcp @ RigidTransform.from_fanuc_wpr([0, 0, 0], w_deg, 0.0, 0.0)
    rays = sensor.camera.rays()
    normal = pose.z_axis
    depth = (normal @ pose.translation_mm) / (rays @ normal[:2] + normal[2])
    return Cloud(points=np.concatenate([rays * depth[..., None], depth[..., None]], axis=2))


@pytest.fixture(scope="module")
def sensor():
    return sensor_preset("rc-visard-65")


@pytest.fixture(scope="module")
def features(sensor):
    rng = np.random.default_rng(3)
    return place_features(tilted_plate(sensor, 20.0), sensor, count=12, rng=rng)


def test_features_have_the_asked_number_names_and_radii(features):
    assert [feature.name for feature in features] == [f"s{i:03d}" for i in range(1, 13)]
    assert all(2.0 <= feature.radius_mm <= 6.0 for feature in features)


def test_the_pose_is_that_of_the_surface(features, sensor):
    part = Part(name="plate", features=features)
    for view in view_features(part, sensor, RigidTransform()):
        assert view.visibility is Visibility.VISIBLE
        assert view.w_deg == pytest.approx(20.0, abs=ANGLE_TOLERANCE_DEG)
        assert view.p_deg == pytest.approx(0.0, abs=ANGLE_TOLERANCE_DEG)


def test_the_same_seed_places_the_same_features(features, sensor):
    rng = np.random.default_rng(3)
    again = place_features(tilted_plate(sensor, 20.0), sensor, count=12, rng=rng)
    assert again == features


def test_a_surface_seen_too_steeply_carries_no_feature(sensor):
    points = np.full((960, 1280, 3), np.nan, dtype=np.float32)
    patch = (slice(470, 490), slice(630, 650))
    points[patch] = tilted_plate(sensor, 20.0).points[patch]
    rules = PlacementRules(max_incidence_deg=1.0)
    with pytest.raises(CloudError, match="good places for 0 features, not for 5"):
        place_features(
            Cloud(points=points), sensor, count=5, rng=np.random.default_rng(0), rules=rules
        )


def test_a_cloud_without_a_point_is_refused(sensor):
    nothing = Cloud(points=np.full((960, 1280, 3), np.nan, dtype=np.float32))
    with pytest.raises(CloudError, match="no valid point"):
        place_features(nothing, sensor, count=5, rng=np.random.default_rng(0))

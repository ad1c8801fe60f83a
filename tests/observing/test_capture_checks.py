"""Captures whose inputs contradict one another are refused, with the reading that fits."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import Cloud, MemoryCampaign, Part
from exposight.errors import ContradictionError, InputError, ObservationError
from exposight.geometry import RigidTransform
from exposight.observing import observe_campaign

# The part's z points at the camera, as a drawing's does; the features' into the material.
TURNED = RigidTransform.from_fanuc_wpr((4, -3, 500), 172, 6, 3)
INTO = RigidTransform(rotation=np.diag([1.0, -1.0, -1.0]))
PLACES = [(-60.0, -40.0), (50.0, -45.0), (-55.0, 45.0), (62.0, 38.0)]


@pytest.fixture
def capture(sensor, make_capture):
    return punched(make_capture(sensor, TURNED @ INTO), PLACES)


def punched(capture, places, radius_mm=6.0):
    """Return a capture of the plate with holes in it."""
    points = capture.cloud.points.copy()
    on_plate = TURNED.inverse().apply(points.reshape(-1, 3).astype(float)).reshape(points.shape)
    for x, y in places:
        points[np.hypot(on_plate[..., 0] - x, on_plate[..., 1] - y) < radius_mm] = np.nan
    return replace(capture, cloud=Cloud(points=points))


def checks(table):
    return [each.check for each in table.contradictions]


@pytest.fixture
def part(hole):
    features = [
        hole(6.0, RigidTransform(translation_mm=[x, y, 0]) @ INTO, f"h{i}")
        for i, (x, y) in enumerate(PLACES)
    ]
    return Part(name="plate", features=tuple(features))


@pytest.fixture
def observed(sensor, capture, part):
    def observe(*, cloud=None, pose=TURNED, features=part, despite=()):
        taken = replace(capture, camera_from_part=pose, cloud=cloud or capture.cloud)
        campaign = MemoryCampaign(name="c", sensor=sensor, part=features, captures=[taken])
        return observe_campaign(campaign, despite=despite)

    return observe


def loose(cloud):
    return Cloud(points=cloud.valid_points)


def test_what_agrees(observed, capture):
    for cloud in (capture.cloud, loose(capture.cloud)):
        table = observed(cloud=cloud)
        assert table.contradictions == ()
        assert table.frame["p_norm"].to_list() == pytest.approx([1.0] * 4, abs=0.01)


@pytest.mark.parametrize(
    ("turn", "option"),
    [((1, -1, -1), "--cloud-axes x -y -z"), ((-1, -1, 1), "--cloud-axes -x -y z")],
)
def test_turned_axes(observed, capture, turn, option):
    points = capture.cloud.points * np.float32(turn)
    with pytest.raises(ContradictionError, match="axes are turned"):
        observed(cloud=Cloud(points=points))
    if turn[2] < 0:
        with pytest.raises(ContradictionError, match=option):
            observed(cloud=loose(Cloud(points=points)))


def test_metres_and_turned_axes_at_once(observed, capture):
    points = 1e-3 * capture.cloud.valid_points * np.float32([1, -1, -1])
    with pytest.raises(ContradictionError, match="--cloud-unit m --cloud-axes x -y -z"):
        observed(cloud=Cloud(points=points))


def test_an_inverse_pose(observed):
    far = RigidTransform.from_fanuc_wpr((400, 100, 500), 172, 36, 3)
    with pytest.raises((ContradictionError, ObservationError)):
        observed(pose=far.inverse())


def test_a_pose_whose_inverse_would_put_the_part_in_view(observed):
    beside = RigidTransform.from_fanuc_wpr((20, 10, 500), 150, 20, 30)
    with pytest.raises(ObservationError, match="inverse of the pose would put the part in view"):
        observed(pose=beside.inverse())


def test_normals_into_the_part(observed, part):
    turned = [replace(f, part_from_feature=f.part_from_feature @ INTO) for f in part.features]
    with pytest.raises(ObservationError, match=r"4 facing away.*outward normals"):
        observed(features=replace(part, features=tuple(turned)))


def test_a_pose_in_metres(observed):
    near = replace(TURNED, translation_mm=TURNED.translation_mm / 1000)
    with pytest.raises(
        ObservationError, match="the pose with its translation in m would put the part in view"
    ):
        observed(pose=near)


def test_a_part_that_stands_elsewhere(observed):
    nearer = replace(TURNED, translation_mm=TURNED.translation_mm - [0, 0, 25])
    with pytest.raises(ContradictionError, match=r"4 of 4 rings .* mm farther"):
        observed(pose=nearer)


def test_a_cloud_of_half_the_resolution(observed, capture):
    half = Cloud(points=capture.cloud.points[::2, ::2].reshape(-1, 3))
    with pytest.raises(ContradictionError, match="every second pixel"):
        observed(cloud=half)
    table = observed(cloud=half, despite=("thinner-than-image",))
    assert [each.check for each in table.contradictions] == ["thinner-than-image"]


def test_points_on_every_second_pixel_of_an_organised_cloud(observed, capture):
    points = np.full_like(capture.cloud.points, np.nan)
    points[1::2, ::2] = capture.cloud.points[1::2, ::2]
    with pytest.raises(ContradictionError, match="every second pixel"):
        observed(cloud=Cloud(points=points))


def test_a_normal_that_is_wrong_by_itself(observed, part):
    first, *others = part.features
    tilt = RigidTransform.from_fanuc_wpr((0, 0, 0), 0, 38, 0)
    tilted = replace(first, part_from_feature=first.part_from_feature @ tilt)
    table = observed(features=replace(part, features=(tilted, *others)))
    rows = table.frame["p_norm"]
    assert rows[1:].to_list() == pytest.approx([1.0] * 3, abs=0.01)
    if rows[0] > 1.1:
        assert "h0" in table.contradictions[0].found


def test_holes_that_are_elsewhere(observed):
    beside = replace(TURNED, translation_mm=np.add(TURNED.translation_mm, [20, 0, 0]))
    assert "no-hole" in checks(observed(pose=beside))


def test_diameters_given_as_radii(observed, part):
    doubled = [replace(each, radius_mm=2 * each.radius_mm) for each in part.features]
    table = observed(features=replace(part, features=tuple(doubled)))
    assert checks(table) == ["no-hole"]
    assert "are the radii diameters" in table.contradictions[0].explanation


def test_features_in_metres(observed, part):
    small = [
        replace(
            each,
            radius_mm=each.radius_mm / 1000,
            part_from_feature=replace(
                each.part_from_feature,
                translation_mm=each.part_from_feature.translation_mm / 1000,
            ),
        )
        for each in part.features
    ]
    assert "small-features" in checks(observed(features=replace(part, features=tuple(small))))


@pytest.mark.parametrize(("off_mm", "found"), [(2.0, []), (6.0, ["points-off-plane"])])
def test_a_plane_that_is_off(observed, off_mm, found):
    nearer = replace(TURNED, translation_mm=TURNED.translation_mm - [0, 0, off_mm])
    assert checks(observed(pose=nearer)) == found


def test_a_cloud_in_a_robots_frame(observed, capture):
    base = RigidTransform.from_fanuc_wpr((300, -200, 900), 175, 10, 30)
    points = base.apply(capture.cloud.valid_points.astype(float))
    with pytest.raises(ContradictionError, match="lie outside of it"):
        observed(cloud=Cloud(points=points))


def test_points_in_a_black_image(sensor, capture, part):
    black = replace(capture, image=np.zeros_like(capture.image), camera_from_part=TURNED)
    campaign = MemoryCampaign(name="c", sensor=sensor, part=part, captures=[black])
    assert checks(observe_campaign(campaign)) == ["points-in-the-dark"]


def test_a_check_that_there_is_not(observed):
    with pytest.raises(InputError, match="did you mean 'own-pixels'"):
        observed(despite=("own-pixel",))

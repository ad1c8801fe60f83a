"""Stereo matching: depth of textured planes, and no point where there is nothing to match."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from exposight.cell import sensor_preset
from exposight.errors import ImageError, SensorError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.imaging.rectification import rectify
from exposight.imaging.stereo import StereoLimits, match_pair, matchable

MEDIAN_SHARE = 0.001
"""Of the depth: 0.03 px of disparity where it is 30 px, the least in these tests."""
DEPTH_LIMITS = (350.0, 900.0)

IDEAL = PinholeCamera(width=240, height=180, fx=240.0, fy=240.0, cx=119.5, cy=89.5)
BASELINE = RigidTransform(translation_mm=np.array([65.0, 0.0, 0.0]))
LEFT_LENS = PinholeCamera(
    width=240, height=180, fx=236.0, fy=238.0, cx=117.2, cy=91.4, skew=0.3,
    distortion=(-0.18, 0.06, 1e-3, -8e-4),
)  # fmt: skip
RIGHT_LENS = PinholeCamera(
    width=250, height=184, fx=241.0, fy=240.0, cx=126.0, cy=90.2,
    distortion=(-0.15, 0.05, -5e-4, 6e-4),
)  # fmt: skip
CONVERGING = RigidTransform.from_fanuc_wpr((64.0, 3.0, -5.0), 1.0, -6.0, 2.0)


@dataclass(frozen=True)
class Plane:
    """normal · point = offset, in the first camera's frame, mm; brightness a function of x, y."""

    normal: tuple[float, float, float] = (0.12, -0.08, 1.0)
    offset_mm: float = 500.0

    def points(self, camera, first_from_camera=None):
        """Where the rays of all pixels meet the plane: (rows, columns, 3), first camera's frame."""
        first_from_camera = first_from_camera or RigidTransform()
        rays = np.concatenate([camera.rays(), np.ones((camera.height, camera.width, 1))], axis=-1)
        directions = rays @ first_from_camera.rotation.T
        normal = np.array(self.normal)
        start = first_from_camera.translation_mm
        reach = (self.offset_mm - normal @ start) / (directions @ normal)
        return start + directions * reach[..., None]


def _texture():
    """Smooth random brightness, 1 mm a pixel, from −400 to 400 mm in x and y."""
    noise = np.random.default_rng(5).standard_normal((801, 801))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip(0.5 + 0.18 * smooth / smooth.std(), 0.0, 1.0).astype(np.float32)


TEXTURE = _texture()


def _photo(plane, camera, first_from_camera=None, *, dark=20.0, bright=210.0):
    xy = (plane.points(camera, first_from_camera)[..., :2] + 400.0).astype(np.float32)
    light = cv2.remap(TEXTURE, xy[..., 0], xy[..., 1], cv2.INTER_CUBIC)
    return np.clip(dark + (bright - dark) * light, 0, 255).round().astype(np.uint8)


def _photos(plane, pair, first_from_second, **brightness):
    return (
        _photo(plane, pair.first, **brightness),
        _photo(plane, pair.second, first_from_second, **brightness),
    )


@pytest.mark.parametrize(
    ("first", "second", "first_from_second"),
    [(IDEAL, IDEAL, BASELINE), (LEFT_LENS, RIGHT_LENS, CONVERGING)],
    ids=["ideal and aligned", "distorted and converging"],
)
def test_depth_of_a_plane_is_recovered_on_the_first_cameras_rays(first, second, first_from_second):
    plane, pair = Plane(), rectify(first, second, first_from_second)
    cloud = match_pair(*_photos(plane, pair, first_from_second), pair, depth_limits_mm=DEPTH_LIMITS)
    truth = plane.points(first)
    error = cloud.points[..., 2] - truth[..., 2]
    assert np.nanmedian(np.abs(error)) < MEDIAN_SHARE * 500.0
    assert abs(np.nanmedian(error)) < 0.5 * MEDIAN_SHARE * 500.0
    # All but the left strip that the second camera does not see, and a rim.
    assert cloud.valid.mean() > 0.7
    on_ray = cloud.points[..., :2] / cloud.points[..., 2:]
    assert np.nanmax(np.abs(on_ray - first.rays())) < 1e-6


def test_an_ideal_aligned_pair_needs_no_turning():
    sensor = sensor_preset("rc-visard-65")
    pair = rectify(*sensor.cameras, sensor.first_from_camera[1])
    image = np.random.default_rng(1).integers(0, 255, (960, 1280), dtype=np.uint8)
    assert pair.camera == sensor.camera
    assert np.array_equal(pair.turn(image, image), [image, image])


def test_rectified_points_lie_on_one_row_and_apart_by_their_disparity():
    pair = rectify(LEFT_LENS, RIGHT_LENS, CONVERGING)
    points = np.random.default_rng(2).uniform((-90, -60, 400), (90, 60, 800), (50, 3))
    second_points = CONVERGING.inverse().apply(points)
    left = pair.camera.project(points @ pair.rectified_from_first.T)
    right = pair.camera.project(second_points @ pair.rectified_from_second.T)
    depth = points @ pair.rectified_from_first[2]
    expected = [pair.disparity_px(z) for z in depth]
    assert left[:, 1] == pytest.approx(right[:, 1], abs=1e-9)
    assert left[:, 0] - right[:, 0] == pytest.approx(expected, abs=1e-9)


def test_rectified_images_are_opencvs_for_the_same_rotation_and_camera():
    lens = replace(LEFT_LENS, skew=0.0)  # OpenCV knows no skew
    pair = rectify(lens, RIGHT_LENS, CONVERGING)
    image = _photo(Plane(), lens)
    size = (pair.camera.width, pair.camera.height)
    maps = cv2.initUndistortRectifyMap(
        lens.matrix, np.array(lens.distortion), pair.rectified_from_first, pair.camera.matrix,
        size, cv2.CV_32FC1,
    )  # fmt: skip
    expected = cv2.remap(image, *maps, cv2.INTER_CUBIC)
    assert np.abs(pair.turn(image, image)[0].astype(int) - expected).mean() < 0.05


def test_rectifying_turns_both_cameras_as_far_as_opencv_does():
    pair = rectify(LEFT_LENS, RIGHT_LENS, CONVERGING)
    second_from_first = CONVERGING.inverse()
    rotations = cv2.stereoRectify(
        LEFT_LENS.matrix, np.array(LEFT_LENS.distortion),
        RIGHT_LENS.matrix, np.array(RIGHT_LENS.distortion),
        (240, 180), second_from_first.rotation, second_from_first.translation_mm[:, None],
    )[:2]  # fmt: skip
    # The x axis is the baseline in both; OpenCV turns about it by halves of the rotation vector,
    # which differs from the mean axis in the second order.
    assert pair.rectified_from_first[0] == pytest.approx(rotations[0][0], abs=1e-9)
    assert np.abs(pair.rectified_from_first - rotations[0]).max() < 0.01
    assert np.abs(pair.rectified_from_second - rotations[1]).max() < 0.01


def test_a_near_plane_keeps_its_left_edge_as_far_as_both_cameras_see_it():
    plane, pair = Plane(normal=(0, 0, 1), offset_mm=400.0), rectify(IDEAL, IDEAL, BASELINE)
    cloud = match_pair(*_photos(plane, pair, BASELINE), pair, depth_limits_mm=(100.0, 900.0))
    disparity = int(pair.disparity_px(400.0))
    assert not cloud.valid[:, : disparity - 1].any()
    assert cloud.valid[20:-20, disparity + 8 : -8].mean() > 0.95


def test_no_points_without_texture():
    pair = rectify(IDEAL, IDEAL, BASELINE)
    images = _photos(Plane(), pair, BASELINE, dark=100.0, bright=110.0)
    cloud = match_pair(*images, pair, depth_limits_mm=DEPTH_LIMITS)
    assert cloud.n_valid == 0


def test_no_points_where_the_images_are_clipped():
    pair = rectify(IDEAL, IDEAL, BASELINE)
    images = _photos(Plane(), pair, BASELINE, dark=150.0, bright=600.0)
    cloud = match_pair(*images, pair, depth_limits_mm=DEPTH_LIMITS)
    assert cloud.n_valid < 0.01 * images[0].size


def test_no_points_where_only_the_second_image_is_clipped():
    plane, pair = Plane(normal=(0, 0, 1)), rectify(IDEAL, IDEAL, BASELINE)
    first, second = _photos(plane, pair, BASELINE)
    disparity = round(pair.disparity_px(500.0))
    second[60:100, 80:120] = 255
    cloud = match_pair(first, second, pair, depth_limits_mm=DEPTH_LIMITS)
    assert not cloud.valid[60:100, 80 + disparity : 120 + disparity].any()


def test_no_points_outside_the_depth_limits():
    plane, pair = Plane(), rectify(IDEAL, IDEAL, BASELINE)
    images = _photos(plane, pair, BASELINE)
    cloud = match_pair(*images, pair, depth_limits_mm=(500.0, 900.0))
    assert np.nanmin(cloud.points[..., 2]) >= 500.0
    assert cloud.n_valid > 1000


def test_matching_does_not_depend_on_the_number_of_threads():
    pair = rectify(IDEAL, IDEAL, BASELINE)
    images = _photos(Plane(), pair, BASELINE)
    threads = cv2.getNumThreads()
    clouds = []
    try:
        for count in (1, 4):
            cv2.setNumThreads(count)
            clouds.append(match_pair(*images, pair, depth_limits_mm=DEPTH_LIMITS).points)
    finally:
        cv2.setNumThreads(threads)
    assert np.array_equal(clouds[0], clouds[1], equal_nan=True)


def test_texture_is_the_standard_deviation_in_the_window():
    image = np.full((40, 40), 100, dtype=np.uint8)
    image[::2] = 114  # 5 rows of one and 4 of the other: σ = 14·√20/9 = 6.96
    assert matchable(image, StereoLimits(min_texture=6.9))[10:30, 10:30].all()
    assert not matchable(image, StereoLimits(min_texture=7.0))[10:30, 10:30].any()


def test_a_fifth_of_clipped_pixels_is_too_many():
    image = np.random.default_rng(3).integers(0, 200, (40, 40), dtype=np.uint8)
    image[:, ::9] = 255  # 9 of 81 pixels in every window
    assert matchable(image, StereoLimits(max_clipped=0.12))[10:30, 10:30].all()
    assert not matchable(image, StereoLimits(max_clipped=9 / 81))[10:30, 10:30].any()


def test_the_left_camera_must_come_first():
    with pytest.raises(SensorError, match=r"to the right of the first.*\(-65, 0, 0\) mm; hand"):
        rectify(IDEAL, IDEAL, BASELINE.inverse())


def test_cameras_must_look_the_same_way():
    away = RigidTransform.from_fanuc_wpr((65.0, 0.0, 0.0), 0.0, 90.0, 0.0)
    with pytest.raises(SensorError, match="at most 60° apart, got 90°"):
        rectify(IDEAL, IDEAL, away)


def test_rectified_images_must_not_grow_too_far():
    wide = replace(IDEAL, fx=60.0, fy=60.0)
    apart = RigidTransform.from_fanuc_wpr((65.0, 0.0, 0.0), 0.0, -50.0, 0.0)
    with pytest.raises(SensorError, match=r"would grow to|turned to one plane"):
        rectify(wide, wide, apart)


def test_images_must_be_of_their_cameras_sizes():
    pair = rectify(LEFT_LENS, RIGHT_LENS, CONVERGING)
    images = _photos(Plane(), pair, CONVERGING)
    with pytest.raises(ImageError, match="the first image has 250 × 184 px, its camera 240 × 180"):
        match_pair(images[1], images[0], pair, depth_limits_mm=DEPTH_LIMITS)


@pytest.mark.parametrize(
    "image", [np.zeros((180, 240), dtype=np.uint16), np.zeros((180, 240, 3), dtype=np.uint8)]
)
def test_images_must_be_grey_and_have_eight_bits(image):
    pair = rectify(IDEAL, IDEAL, BASELINE)
    with pytest.raises(ImageError, match=r"grey images .* of uint8, got"):
        match_pair(image, image, pair, depth_limits_mm=DEPTH_LIMITS)


@pytest.mark.parametrize("limits", [(0.0, 500.0), (500.0, 400.0), (100.0, np.inf)])
def test_depth_limits_must_be_a_range(limits):
    pair = rectify(IDEAL, IDEAL, BASELINE)
    image = np.zeros((180, 240), dtype=np.uint8)
    with pytest.raises(ImageError, match="0 < near < far"):
        match_pair(image, image, pair, depth_limits_mm=limits)


def test_a_near_limit_beyond_the_matchers_range_says_what_would_do():
    pair = rectify(IDEAL, IDEAL, BASELINE)
    image = np.zeros((180, 240), dtype=np.uint8)
    with pytest.raises(ImageError, match="raise the near limit to 8 mm"):
        match_pair(image, image, pair, depth_limits_mm=(1.0, 500.0))


@pytest.mark.parametrize("wrong", [{"window_px": 8}, {"max_clipped": 0.0}, {"min_texture": -1.0}])
def test_limits_must_make_sense(wrong):
    with pytest.raises(ImageError, match="stereo matching needs"):
        StereoLimits(**wrong)

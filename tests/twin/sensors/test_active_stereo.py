"""The active stereo sensor: depth against the mesh, and points missing for the right reasons."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, map_coordinates

from exposight.cell import sensor_preset
from exposight.errors import InputError, SensorError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.twin.light import LightModel, ProjectorLens, SceneTracer, trace_view
from exposight.twin.sensors import DotSensor
from exposight.twin.sensors.exposure import spread_by_lens
from exposight.twin.sensors.patterns import BLURS_PX, render_dots, slide_radiance
from exposight.twin.sensors.settings import DOT_CAMERA, DOT_PROJECTOR

DEPTH_MEDIAN_MM = 0.3
"""0.1 px of disparity at 0.5 m; a third of the 0.9 mm that Roboception gives there."""
DEPTH_BIAS_MM = 0.05
GOOD_MS = 8.0
SEED = (7, 0, 0)
DOT_LIGHT = LightModel(projector=DOT_PROJECTOR)


def _cut(sensor, distortion=()):
    """The middle 480 × 160 px of both cameras."""
    full = sensor.camera
    camera = PinholeCamera(
        width=480, height=160, fx=full.fx, fy=full.fy, cx=300.0, cy=79.5, distortion=distortion
    )
    return replace(sensor, cameras=(camera, camera))


@pytest.fixture(scope="module")
def sensor():
    return _cut(sensor_preset("rc-visard-65"))


@pytest.fixture(scope="module")
def dot_sensor(sensor):
    return DotSensor(sensor=sensor)


@pytest.fixture(scope="module")
def primer(plate):
    return SceneTracer(plate("primer", ((-40.0, 0.0, 10.0),), half_mm=(250.0, 200.0), step_mm=10.0))


@pytest.fixture(scope="module")
def light(dot_sensor, primer, before):
    return dot_sensor.look(primer, before(500.0, 5.0, -0.5))


@pytest.fixture(scope="module")
def true_depth_mm(sensor, primer, before):
    """Z behind each pixel of the first camera, NaN where nothing is."""
    model = LightModel(indirect=False)
    return trace_view(primer, sensor, before(500.0, 5.0, -0.5), model=model).tiles[0].depth_mm


@pytest.fixture(scope="module")
def capture(dot_sensor, light):
    return dot_sensor.capture(light, GOOD_MS, view="v", seed=SEED)


def _brighter(sensor, factor):
    electronics = replace(DOT_CAMERA, electrons_per_ms=factor * DOT_CAMERA.electrons_per_ms)
    return DotSensor(sensor=sensor, electronics=electronics)


def test_depth_on_primer_is_the_meshs(capture, true_depth_mm):
    error = capture.cloud.points[..., 2] - true_depth_mm
    assert np.nanmedian(np.abs(error)) < DEPTH_MEDIAN_MM
    assert abs(np.nanmedian(error)) < DEPTH_BIAS_MM


def test_every_place_that_both_cameras_see_has_a_point(capture, dot_sensor, true_depth_mm):
    hidden = int(dot_sensor.pair.disparity_px(480.0)) + 10
    on_part = np.isfinite(true_depth_mm[:, hidden:-10])
    assert capture.cloud.valid[:, hidden:-10][on_part].mean() > 0.95


def test_a_hole_has_points_only_at_its_rim_as_far_as_a_window_reaches(capture, true_depth_mm):
    in_hole = np.isnan(true_depth_mm)
    middle = binary_erosion(in_hole, iterations=7)  # 4 px of texture window, 3 px of match
    assert middle.sum() > 500
    assert not capture.cloud.valid[middle].any()


def test_the_capture_is_the_first_cameras(capture, sensor, dot_sensor, light):
    capture.check_fits(sensor)
    assert capture.cloud.organised
    assert np.array_equal(capture.image, dot_sensor.images(light, GOOD_MS, SEED)[0])
    on_ray = capture.cloud.points[..., :2] / capture.cloud.points[..., 2:]
    assert np.nanmax(np.abs(on_ray - sensor.camera.rays())) < 1e-6


def test_the_stack_is_that_of_the_matching_window(capture, dot_sensor):
    assert capture.brightness_source == "dots"
    assert capture.stack.min_modulation == dot_sensor.matching.min_texture
    for v, u in ((60, 200), (100, 333)):
        window = capture.image[v - 4 : v + 5, u - 4 : u + 5].astype(np.float64)
        assert capture.stack.mean[v, u] == np.floor(window.mean() + 0.5)
        assert capture.stack.maximum[v, u] == np.percentile(window, 80)
        assert capture.stack.modulation[v, u] == pytest.approx(2 * window.std(), abs=0.5)


def test_lenses_with_distortion_and_turned_cameras_measure_the_same_plate(sensor, primer, before):
    second = RigidTransform.from_fanuc_wpr((65.0, 1.0, -2.0), 0.5, -3.0, 1.0)
    bent = _cut(sensor, (-0.15, 0.08, 1e-3, -5e-4))
    bent = replace(bent, first_from_camera=(RigidTransform(), second))
    dots = DotSensor(sensor=bent)
    light = dots.look(primer, before(500.0, 5.0, -0.5))
    cloud = dots.capture(light, GOOD_MS, view="v", seed=SEED).cloud
    true = trace_view(primer, bent, before(500.0, 5.0, -0.5), model=LightModel(indirect=False))
    error = cloud.points[..., 2] - true.tiles[0].depth_mm
    assert cloud.valid.mean() > 0.5
    assert np.nanmedian(np.abs(error)) < DEPTH_MEDIAN_MM
    assert abs(np.nanmedian(error)) < DEPTH_BIAS_MM


def test_the_sensitivity_follows_the_rule(dot_sensor, plate, before):
    """Bare sheet at the TCP, turned by w = 5°, p = −0.5°, has 126 grey levels at 9 ms."""
    bare = SceneTracer(plate("bare", half_mm=(250.0, 200.0), step_mm=10.0))
    light = dot_sensor.look(bare, before(500.0, 5.0, -0.5))
    image = dot_sensor.images(light, 9.0, SEED)[0]
    assert image[50:110, 270:330].mean() == pytest.approx(126.0, abs=3.0)


def test_a_dark_image_has_no_points(dot_sensor, light):
    assert dot_sensor.capture(light, 0.1, view="v", seed=SEED).cloud.n_valid == 0


def test_a_clipped_image_has_hardly_any_points(sensor, light, capture):
    cloud = _brighter(sensor, 20.0).capture(light, GOOD_MS, view="v", seed=SEED).cloud
    assert cloud.n_valid < 0.1 * capture.cloud.n_valid


def test_points_start_between_8_and_20_grey_levels(sensor, light, capture):
    # Table 9 of the paper: with the stereo sensor, p_norm ≥ 0.75 from 12 grey levels on.
    mean = capture.image[:, 200:].mean()
    shares = [
        _brighter(sensor, grey / mean).capture(light, GOOD_MS, view="v", seed=SEED).cloud.n_valid
        / capture.cloud.n_valid
        for grey in (8.0, 20.0)
    ]
    assert shares[0] < 0.25
    assert shares[1] > 0.9


def test_a_projector_out_of_focus_leaves_less_texture(sensor, primer, before):
    shares = []
    for defocus in (0.0, 4000.0):
        lens = ProjectorLens(sharp_blur_px=0.7, defocus_px_mm=defocus, focus_mm=150.0)
        dots = DotSensor(sensor=sensor, light=replace(DOT_LIGHT, projector=lens))
        light = dots.look(primer, before(500.0, 5.0, -0.5))
        shares.append(dots.capture(light, 2.5, view="v", seed=SEED).cloud.valid.mean())
    assert shares[1] < 0.2 * shares[0]


def test_same_seed_same_bytes_and_another_seed_another_noise(dot_sensor, light, capture):
    again = dot_sensor.capture(light, GOOD_MS, view="v", seed=SEED)
    other = dot_sensor.capture(light, GOOD_MS, view="v", seed=(7, 0, 1))
    assert np.array_equal(again.image, capture.image)
    assert np.array_equal(again.cloud.points, capture.cloud.points, equal_nan=True)
    assert (other.image != capture.image).mean() > 0.3


def test_the_two_cameras_do_not_share_their_noise(dot_sensor, light):
    even = replace(light, radiance=(light.radiance[0], light.radiance[0]))
    first, second = dot_sensor.images(even, GOOD_MS, SEED)
    noise = first.astype(float) - second
    assert noise[first < 200].std() > 1.0


def test_each_pixel_gets_the_light_that_its_place_on_the_slide_lets_through(sensor, primer, before):
    lens = replace(DOT_LIGHT.camera, spread_px=0.0)
    view = trace_view(
        primer, sensor, before(500.0), model=replace(DOT_LIGHT, camera=lens, indirect=True)
    )
    slide = render_dots(1800, 1334, 0.9)
    (tile,) = view.tiles
    place = [tile.row, tile.column]
    shares = np.array([map_coordinates(s / 65535.0, place, order=1, mode="nearest") for s in slide])
    squares = np.array(BLURS_PX) ** 2
    blur = tile.blur_px.astype(float) ** 2
    level = np.clip(np.searchsorted(squares, blur) - 1, 0, len(squares) - 2)
    t = np.clip((blur - squares[level]) / (squares[level + 1] - squares[level]), 0.0, 1.0)
    low, high = (np.take_along_axis(shares, level[None] + i, axis=0)[0] for i in (0, 1))
    expected = tile.direct * ((1 - t) * low + t * high)
    expected = expected + tile.indirect * (slide[0].mean() / 65535.0) + tile.ambient
    radiance = spread_by_lens(slide_radiance(tile, slide)[None], tile, view.model.camera.spread_px)
    assert radiance[0] == pytest.approx(expected[tile.inside], rel=1e-4)


def test_dots_leave_no_neighbourhood_empty_and_cover_a_quarter():
    sharp = render_dots(256, 192, 1.0)[0] / 65535.0
    assert sharp.shape == (192, 256)
    assert 0.15 < sharp.mean() < 0.3
    blocks = sharp[:192, :256].reshape(24, 8, 32, 8).max(axis=(1, 3))
    assert blocks.min() > 0.3


def test_contrast_sets_the_light_that_the_dark_parts_pass():
    sharp = render_dots(256, 256, 0.8)[0] / 65535.0
    assert sharp.min() == pytest.approx(0.1, abs=2e-3)


def test_blur_takes_contrast_and_keeps_the_light():
    slide = render_dots(256, 256, 0.9) / 65535.0
    middle = slide[:, 32:-32, 32:-32]
    assert (np.diff(middle.std(axis=(1, 2))) < 0).all()
    assert middle.mean(axis=(1, 2)) == pytest.approx(np.full(len(BLURS_PX), middle[0].mean()), 0.01)


def test_one_camera_is_not_enough():
    with pytest.raises(SensorError, match="active stereo needs two cameras, got 1"):
        DotSensor(sensor=sensor_preset("comet-pro-ae"))


def test_dots_need_a_projector(sensor):
    with pytest.raises(SensorError, match="has no projector"):
        DotSensor(sensor=replace(sensor, projector=None))


def test_the_left_camera_comes_first(sensor):
    swapped = replace(
        sensor, first_from_camera=(RigidTransform(), sensor.first_from_camera[1].inverse())
    )
    with pytest.raises(SensorError, match="to the right of the first"):
        DotSensor(sensor=swapped)


def test_an_exposure_time_out_of_range_is_refused(dot_sensor, light):
    with pytest.raises(SensorError, match=r"0\.07 to 18 ms, got 20 ms"):
        dot_sensor.capture(light, 20.0, view="v", seed=SEED)


def test_a_view_of_nothing_is_refused(dot_sensor, primer):
    away = RigidTransform(translation_mm=np.array([5000.0, 0.0, 500.0]))
    with pytest.raises(InputError, match="sees nothing of the part"):
        dot_sensor.look(primer, away)

"""The structured-light sensor: frames that the decoder of recordings turns into points."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from exposight.errors import ImageError, SensorError
from exposight.geometry import PixelBox
from exposight.imaging import (
    AxisCoding,
    Fringe,
    GrayCode,
    GreyNoise,
    PatternSequence,
    decode,
    triangulate,
    with_sigma_z,
)
from exposight.observing import observe_capture, point_search, view_features
from exposight.twin.light import CameraLens, LightModel, SceneTracer, trace_view
from exposight.twin.sensors import StripeSensor, ring_boxes

HOLES = ((-25.0, -12.0, 4.0), (15.0, 10.0, 7.0))
SEED = (1, 2, 3)
BEST_MS = 150.0
"""Brings primer at the TCP to about 110 grey levels, short of clipping."""


@pytest.fixture(scope="module")
def sheet(plate):
    return SceneTracer(plate("primer", HOLES))


@pytest.fixture(scope="module")
def stripes(small_sensor) -> StripeSensor:
    return StripeSensor(sensor=small_sensor)


@pytest.fixture(scope="module")
def light(stripes, sheet, before):
    return stripes.look(sheet, before())


@pytest.fixture(scope="module")
def true_depth_mm(small_sensor, sheet, before):
    """Z behind each pixel of the first camera, NaN where nothing is."""
    model = LightModel(indirect=False)
    return trace_view(sheet, small_sensor, before(), model=model).tiles[0].depth_mm


def _observe(capture, stripes, part):
    views = view_features(part, stripes.sensor, capture.camera_from_part)
    return observe_capture(capture, views, point_search(capture.cloud, stripes.sensor.camera))


def test_depth_is_right_at_the_best_exposure(stripes, light, true_depth_mm) -> None:
    capture = stripes.capture(light, BEST_MS, view="v", seed=SEED)
    error = capture.cloud.points[..., 2] - true_depth_mm
    error = error[np.isfinite(error)]
    assert error.size > 0.9 * np.isfinite(true_depth_mm).sum()
    # The bounds.
    assert np.median(np.abs(error)) < 0.1
    assert abs(np.median(error)) < 0.02


def test_depth_is_right_through_distorting_lenses(small_sensor, with_lens, sheet, before) -> None:
    stripes = StripeSensor(sensor=with_lens(small_sensor))
    light = stripes.look(sheet, before())
    capture = stripes.capture(light, BEST_MS, view="v", seed=SEED)
    true = trace_view(sheet, stripes.sensor, before(), model=LightModel(indirect=False))
    error = capture.cloud.points[..., 2] - true.tiles[0].depth_mm
    assert np.nanmedian(np.abs(error)) < 0.1
    assert abs(np.nanmedian(error)) < 0.02


def test_p_norm_rises_stays_and_falls_with_exposure(stripes, light, hole_part) -> None:
    part = hole_part(HOLES)
    p_norm = {}
    for exposure_ms in (8.0, 100.0, 400.0):
        capture = stripes.capture(light, exposure_ms, view="v", seed=SEED)
        p_norm[exposure_ms] = [row.p_norm for row in _observe(capture, stripes, part)]
    assert max(p_norm[8.0]) <= 0.2
    assert min(p_norm[100.0]) >= 0.95
    assert max(p_norm[400.0]) <= 0.1


def test_rings_only_observe_exactly_what_whole_frames_do(
    small_sensor, with_lens, plate, before, hole_part
) -> None:
    stripes = StripeSensor(sensor=with_lens(small_sensor))
    tracer = SceneTracer(plate("bare", HOLES, wall_at_mm=30.0))
    part, pose = hole_part(HOLES), before()
    whole = stripes.look(tracer, pose)
    rings = stripes.look(tracer, pose, ring_boxes(part, stripes.sensor, pose))
    assert whole.is_whole
    assert not rings.is_whole
    assert sum(tile.even.size for tile in rings.tiles) < 0.3 * whole.tiles[0].even.size
    partly = 0
    for exposure_ms in (20.0, 40.0, 60.0, 90.0):
        pairs = [
            _observe(stripes.capture(light, exposure_ms, view="v", seed=SEED), stripes, part)
            for light in (whole, rings)
        ]
        assert pairs[0] == pairs[1]
        partly += sum(0.05 < row.p_norm < 0.95 for row in pairs[0])
    assert partly  # not only all or nothing


def test_points_of_the_rings_are_those_of_the_whole_frame(
    stripes, light, sheet, hole_part, before
) -> None:
    boxes = ring_boxes(hole_part(HOLES), stripes.sensor, before())
    rings = stripes.capture(stripes.look(sheet, before(), boxes), BEST_MS, view="v", seed=SEED)
    whole = stripes.capture(light, BEST_MS, view="v", seed=SEED)
    assert not rings.cloud.organised
    known = {point.tobytes() for point in whole.cloud.valid_points}
    assert all(point.tobytes() in known for point in rings.cloud.points)
    taken = rings.image > 0
    assert np.array_equal(rings.image[taken], whole.image[taken])


def test_a_view_without_features_gives_an_empty_cloud(stripes, sheet, before) -> None:
    capture = stripes.capture(stripes.look(sheet, before(), []), 50.0, view="v", seed=SEED)
    assert capture.cloud.n_valid == 0
    assert not capture.image.any()


def test_frames_do_not_depend_on_the_number_of_threads(stripes, sheet, before) -> None:
    threads = numba.get_num_threads()
    box = PixelBox(top=100, bottom=200, left=120, right=260)

    def taken() -> bytes:
        (stack,) = stripes.frames(stripes.look(sheet, before(), [box]), 60.0, SEED)
        return stack.frames.tobytes()

    many = taken()
    numba.set_num_threads(1)
    try:
        assert taken() == many
    finally:
        numba.set_num_threads(threads)


def test_another_seed_gives_other_noise(stripes, light) -> None:
    a, b = (stripes.frames(light, 60.0, (1, 2, i))[0].frames for i in (0, 1))
    assert 0.3 < np.mean(a != b) < 1.0


def test_the_image_is_the_mean_of_the_finest_stripes_or_the_first_of_them(stripes, light) -> None:
    stack = stripes.frames(light, 60.0, SEED)[0]
    mean = stripes.capture(light, 60.0, view="v", seed=SEED).image
    assert np.array_equal(mean, np.floor(stack.frames[8:12].mean(axis=0) + 0.5))
    first = replace(stripes, image="first").capture(light, 60.0, view="v", seed=SEED)
    assert np.array_equal(first.image, stack.frames[8])


@pytest.mark.parametrize("exposure_ms", [40.0, 400.0])
def test_the_stack_is_what_its_frames_say(stripes, light, exposure_ms) -> None:
    (stack,) = stripes.frames(light, exposure_ms, SEED)
    frames = stack.frames.astype(np.float64)
    capture = stripes.capture(light, exposure_ms, view="v", seed=SEED)
    assert capture.brightness_source == "stripes-mean"
    assert capture.stack.mean is None
    assert capture.stack.min_modulation == stripes.limits.min_modulation
    assert np.array_equal(capture.stack.maximum, frames.max(axis=0))
    # Four equal steps: 2·B = |(I₁ − I₃) + i·(I₂ − I₄)| for the weakest of three fringes.
    steps = frames.reshape(3, 4, *frames.shape[1:])
    swing = np.hypot(steps[:, 0] - steps[:, 2], steps[:, 1] - steps[:, 3]).min(axis=0)
    assert np.abs(capture.stack.modulation - np.minimum(swing, 255)).max() <= 0.5 + 1e-3
    first = replace(stripes, image="first").capture(light, exposure_ms, view="v", seed=SEED)
    assert first.brightness_source == "stripe"
    assert np.array_equal(first.stack.mean, capture.image)
    assert np.array_equal(first.stack.modulation, capture.stack.modulation)


def test_a_rings_columns_are_those_of_its_raw_frames(stripes, light, hole_part) -> None:
    exposure_ms, part = 120.0, hole_part(HOLES)
    frames = stripes.frames(light, exposure_ms, SEED)[0].frames.astype(np.float64)
    capture = stripes.capture(light, exposure_ms, view="v", seed=SEED)
    views = view_features(part, stripes.sensor, capture.camera_from_part)
    for view, row in zip(views, _observe(capture, stripes, part), strict=True):
        pixels = frames[:, view.rows, view.columns]
        steps = pixels.reshape(3, 4, -1)
        amplitude = np.hypot(steps[:, 0] - steps[:, 2], steps[:, 1] - steps[:, 3]).min(axis=0) / 2
        # Rounded images: half a grey level, and half of that for amplitudes.
        assert row.i_mean == pytest.approx(steps[2].mean(), abs=0.5)
        assert row.i_mean == pytest.approx(row.i_avg, abs=1e-9)
        assert row.i_max_p75 == np.percentile(pixels.max(axis=0), 75)
        assert row.i_mod_p05 == pytest.approx(np.percentile(amplitude, 5), abs=0.26)
        assert row.stack_clipped_share == np.mean(pixels.max(axis=0) == 255)
        limit = stripes.limits.min_modulation
        low = np.mean(amplitude < limit - 0.26), np.mean(amplitude < limit + 0.26)
        assert low[0] <= row.low_modulation_share <= low[1]


def test_a_rings_stack_is_0_where_nothing_was_taken(stripes, light, sheet, hole_part, before):
    boxes = ring_boxes(hole_part(HOLES), stripes.sensor, before())
    rings = stripes.capture(stripes.look(sheet, before(), boxes), 60.0, view="v", seed=SEED)
    whole = stripes.capture(light, 60.0, view="v", seed=SEED)
    taken = np.zeros(whole.image.shape, dtype=bool)
    for box in boxes:
        taken[box.top : box.bottom, box.left : box.right] = True
    for name, image in rings.stack.images().items():
        assert np.array_equal(image[taken], whole.stack.images()[name][taken])
    assert rings.stack.maximum[~rings.image.astype(bool)].max() == 0


def test_without_inverse_frames_a_gray_codes_image_is_the_mean_of_white_and_black(stripes):
    bits = GrayCode(frames=tuple(range(2, 13)))
    sequence = replace(
        stripes.sequence, columns=AxisCoding(gray_code=bits), white_frame=0, black_frame=1
    )
    assert sequence.finest_frames == (0, 1)
    inverses = replace(bits, inverse_frames=tuple(range(13, 24)))
    sequence = replace(sequence, columns=AxisCoding(gray_code=inverses))
    assert sequence.finest_frames == (12, 23)


def test_the_sensitivity_follows_the_rule(small_sensor, plate, before) -> None:
    """Bare sheet at the TCP, turned by w = 6°, p = −1°, has 50 grey levels at 25 ms."""
    camera = replace(small_sensor.camera, width=160, height=160, cx=79.5, cy=79.5)
    scanner = StripeSensor(sensor=replace(small_sensor, cameras=(camera,)))
    light = scanner.look(SceneTracer(plate("bare", step_mm=10.0)), before(600.0, 6.0, -1.0))
    image = scanner.capture(light, 25.0, view="v", seed=SEED).image
    assert image[50:110, 50:110].mean() == pytest.approx(50.0, abs=1.0)


def test_a_camera_of_12_bits_sees_what_one_of_8_does(stripes, light) -> None:
    deep = replace(
        stripes,
        electronics=replace(stripes.electronics, bit_depth=12),
        sequence=replace(stripes.sequence, bit_depth=12),
    )
    eight, twelve = (s.capture(light, 60.0, view="v", seed=SEED) for s in (stripes, deep))
    assert twelve.image.dtype == np.uint16
    assert twelve.bit_depth == 12
    assert twelve.image.astype(float) * 255 / 4095 == pytest.approx(eight.image, abs=1.0)
    with pytest.raises(ImageError, match=r"8 bits, sequence .* 12; say the same in both"):
        replace(stripes, sequence=deep.sequence)


@pytest.mark.parametrize(
    "curve", [{"camera_gamma": 2.2}, {"projector_gamma": 2.2}, {"saturation_level": 240}]
)
def test_curves_that_the_simulated_cell_has_not_are_refused(stripes, curve) -> None:
    with pytest.raises(SensorError, match="are linear up to full scale; leave the response"):
        replace(stripes, sequence=replace(stripes.sequence, **curve))


def test_rings_of_captures_know_the_noise_of_their_points(
    stripes, light, sheet, before, hole_part
) -> None:
    part = hole_part(HOLES)
    boxes = ring_boxes(part, stripes.sensor, before())
    rings = stripes.look(sheet, before(), boxes)
    whole, listed = (
        stripes.capture(each, BEST_MS, view="v", seed=SEED).cloud for each in (light, rings)
    )
    assert listed.sigma_z_mm.shape == listed.valid.shape
    assert np.isin(listed.sigma_z_mm, whole.sigma_z_mm).all()
    bright, dim = (
        _observe(stripes.capture(light, ms, view="v", seed=SEED), stripes, part)[0].sigma_z_mm
        for ms in (BEST_MS, BEST_MS / 2)
    )
    assert 0.0 < bright < dim


def test_depth_noise_is_predicted_and_can_be_limited(stripes, light, true_depth_mm) -> None:
    whole, again = (stripes.capture(light, 60.0, view="v", seed=(4, 5, i)).cloud for i in (0, 1))
    (stack,) = stripes.frames(light, 60.0, (4, 5, 0))
    (tile,) = light.tiles
    decoded = stripes.decode(stack)
    predicted = stripes.points(stack, decoded, tile.box).sigma_z_mm
    scatter = (whole.points[..., 2] - again.points[..., 2]) / np.sqrt(2.0) / predicted
    assert np.nanstd(scatter) == pytest.approx(1.0, rel=0.05)
    # A filter takes a half full pixel's noise.
    grey_noise = stripes.half_full_noise_e * stripes.electronics.gain
    lamp = stripes.sensor.projector
    filtered = with_sigma_z(
        whole,
        stack,
        stripes.sequence,
        GreyNoise(dark=grey_noise**2),
        projector=lamp.camera,
        projector_from_camera=lamp.camera_from_projector.inverse(),
    ).sigma_z_mm
    limit = float(np.nanmedian(filtered))
    quiet = replace(stripes, max_depth_noise_mm=limit)
    kept = quiet.capture(light, 60.0, view="v", seed=(4, 5, 0)).cloud
    np.testing.assert_array_equal(kept.valid, whole.valid & (filtered <= limit))
    error = np.abs(whole.points[..., 2] - true_depth_mm)
    assert np.nanmedian(error[kept.valid]) < np.nanmedian(error[whole.valid & ~kept.valid])
    bits = AxisCoding(gray_code=GrayCode(frames=tuple(range(2, 13))))
    gray = replace(stripes.sequence, columns=bits, white_frame=0, black_frame=1)
    with pytest.raises(SensorError, match="has an axis without; leave out max_depth_noise_mm"):
        replace(quiet, sequence=gray)


def test_mean_of_a_fringes_steps_is_half_the_full_light(stripes, light) -> None:
    stack = stripes.frames(light, 60.0, SEED)[0]
    electronics = stripes.electronics
    expected = (
        60.0 * electronics.electrons_per_ms * light.tiles[0].even
        + 60.0 * electronics.dark_current_e_per_s / 1000
    ) * electronics.gain + electronics.black
    lit = light.tiles[0].even > 0.5 * light.tiles[0].even.max()
    assert stack.frames[8:12].mean(axis=0)[lit].mean() == pytest.approx(
        expected[lit].mean(), rel=0.002
    )


def test_the_lens_spreads_light_and_loses_none(stripes, sheet, before) -> None:
    sharp = replace(stripes, light=LightModel(camera=CameraLens(spread_px=0.0)))
    soft = stripes.look(sheet, before()).tiles[0].even
    hard = sharp.look(sheet, before()).tiles[0].even
    assert soft.sum() == pytest.approx(hard.sum(), rel=1e-4)
    hole = (slice(150, 175), slice(200, 245))
    assert np.abs(np.diff(soft[hole], axis=1)).max() < np.abs(np.diff(hard[hole], axis=1)).max()


def test_indirect_light_lowers_the_contrast(stripes, plate, before) -> None:
    tracer = SceneTracer(plate("primer", wall_at_mm=-15.0))
    contrasts = []
    for indirect in (False, True):
        sensor = replace(stripes, light=LightModel(indirect=indirect))
        tile = sensor.look(tracer, before()).tiles[0]
        near = (slice(120, 180), slice(185, 200))
        size = np.hypot(tile.cosine[2], tile.sine[2])[near]
        contrasts.append((size.sum() / tile.even[near].sum()).item())
    assert contrasts[1] < contrasts[0] - 0.01


def test_an_exposure_the_sensor_cannot_take_is_refused(stripes, light) -> None:
    with pytest.raises(SensorError, match="from 1 to 1000 ms, got 2000 ms"):
        stripes.capture(light, 2000.0, view="v", seed=SEED)


def test_stripes_of_another_size_are_refused(small_sensor) -> None:
    stripes = replace(StripeSensor(sensor=small_sensor).sequence, projector_width=1024)
    with pytest.raises(SensorError, match="use stripes of the projector's size"):
        StripeSensor(sensor=small_sensor, sequence=stripes)


def test_a_sensor_without_projector_is_refused(small_sensor) -> None:
    with pytest.raises(SensorError, match="has no projector"):
        StripeSensor(sensor=replace(small_sensor, projector=None))


def test_three_step_sequences_work_as_well(small_sensor, sheet, before, true_depth_mm) -> None:
    sequence = PatternSequence(
        name="three steps",
        projector_width=1920,
        projector_height=1200,
        columns=AxisCoding(
            fringes=(
                Fringe(periods=1, frames=(5, 4, 3)),
                Fringe(periods=12, frames=(0, 1, 2)),
                Fringe(periods=80, frames=(6, 7, 8), shifts_deg=(120.0, 0.0, -120.0)),
            )
        ),
    )
    stripes = StripeSensor(sensor=small_sensor, sequence=sequence)
    light = stripes.look(sheet, before())
    capture = stripes.capture(light, BEST_MS, view="v", seed=SEED)
    error = capture.cloud.points[..., 2] - true_depth_mm
    assert np.isfinite(error).mean() > 0.1
    assert np.nanmedian(np.abs(error)) < 0.1


def test_a_window_of_the_map_gives_the_very_points_of_the_whole(stripes, light) -> None:
    stack = stripes.frames(light, BEST_MS, SEED)[0]
    lamp = stripes.sensor.projector
    poses = {
        "camera": stripes.sensor.camera,
        "projector": lamp.camera,
        "projector_from_camera": lamp.camera_from_projector.inverse(),
    }
    whole = triangulate(decode(stack, stripes.sequence, stripes.limits), **poses)
    box = PixelBox(top=90, bottom=180, left=110, right=290)
    cut = replace(stack, frames=stack.frames[:, 90:180, 110:290].copy())
    decoded = decode(cut, stripes.sequence, stripes.limits)
    part = triangulate(decoded, **poses, window=box)
    assert np.array_equal(part.points, whole.points[90:180, 110:290], equal_nan=True)
    with pytest.raises(ImageError, match="the window 179 × 90"):
        triangulate(decoded, **poses, window=replace(box, left=111))
    with pytest.raises(ImageError, match="must lie within 400 × 300 px"):
        triangulate(decoded, **poses, window=PixelBox(top=-10, bottom=80, left=0, right=180))

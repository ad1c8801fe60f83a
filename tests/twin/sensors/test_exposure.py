"""Cameras: linear until they clip, with the noise that EMVA 1288 would measure."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from exposight.errors import InputError, SensorError
from exposight.twin.random_numbers import stream_key
from exposight.twin.sensors import CameraElectronics, expose

CAMERA = CameraElectronics()
UNIT = 1.0 / CAMERA.electrons_per_ms
"""Radiance that brings one electron a millisecond."""


def _flat(electrons_per_ms: float, n: int = 1, side: int = 400):
    """Even light, and n frames that add nothing to it."""
    even = np.full((side, side), electrons_per_ms * UNIT, dtype=np.float32)
    frames = np.zeros((n, 2), dtype=np.int64), np.zeros((n, 2), dtype=np.float32)
    return (even, even[None], even[None]), frames


def test_mean_signal_is_linear_in_exposure_until_it_clips() -> None:
    quiet = replace(CAMERA, dark_current_e_per_s=0.0)
    times = np.array([10.0, 20.0, 40.0, 60.0, 80.0])
    means = [
        (expose(*_flat(100.0), t, quiet, noise_key=stream_key(1, int(t))).mean() - quiet.black)
        / quiet.gain
        for t in times
    ]
    slope = (times @ means) / (times @ times)
    assert slope == pytest.approx(100.0, rel=0.005)
    # The bound: 0.5 % of the signal at every exposure
    assert np.abs(np.array(means) / (slope * times) - 1).max() < 0.005


def test_photon_transfer_gives_the_gain_back() -> None:
    """EMVA 1288: the variance of the difference of two flats, over the mean."""
    means, variances = [], []
    for t in (10.0, 20.0, 30.0, 40.0, 50.0, 60.0):
        pair = expose(*_flat(100.0, 2, 700), t, CAMERA, noise_key=stream_key(2, int(t))).astype(
            float
        )
        means.append(pair.mean())
        variances.append((pair[0] - pair[1]).var() / 2)
    gain = np.polyfit(means, variances, 1)[0]
    assert gain == pytest.approx(CAMERA.gain, rel=0.02)


def test_read_noise_remains_without_light() -> None:
    # A deep camera, whose levels are fine enough for 13 electrons, clear of 0.
    camera = replace(CAMERA, dark_current_e_per_s=0.0, prnu=0.0, bit_depth=12)
    image = expose(*_flat(0.0), 1.0, camera, noise_key=stream_key(3)).astype(float)
    expected = camera.gain**2 * 13.0**2 + 1 / 12  # and the rounding to grey levels
    assert image.var() == pytest.approx(expected, rel=0.02)


def test_grey_values_clip_at_255() -> None:
    assert (expose(*_flat(1e6), 10.0, CAMERA, noise_key=stream_key(4)) == 255).all()


def test_the_fixed_pattern_stays_from_image_to_image() -> None:
    camera = replace(CAMERA, full_well_e=1e7, prnu=0.05)  # next to no noise else
    first = expose(*_flat(1e5), 50.0, camera, noise_key=stream_key(5))
    second = expose(*_flat(1e5), 50.0, camera, noise_key=stream_key(6))
    other = expose(*_flat(1e5), 50.0, replace(camera, pattern_seed=2), noise_key=stream_key(5))
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.99
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.02
    assert first.std() / (first.mean() - camera.black) == pytest.approx(0.05, rel=0.02)


def test_dark_current_grows_with_time() -> None:
    camera = replace(CAMERA, dark_current_e_per_s=1e5)
    image = expose(*_flat(0.0), 50.0, camera, noise_key=stream_key(7))
    assert image.mean() == pytest.approx(10.0 + 5000 * camera.gain, rel=0.005)


def test_images_do_not_depend_on_the_number_of_threads() -> None:
    threads = numba.get_num_threads()
    many = expose(*_flat(100.0), 30.0, CAMERA, noise_key=stream_key(8))
    numba.set_num_threads(1)
    try:
        one = expose(*_flat(100.0), 30.0, CAMERA, noise_key=stream_key(8))
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(many, one)


def test_another_key_gives_other_noise() -> None:
    a, b = (expose(*_flat(100.0), 30.0, CAMERA, noise_key=stream_key(k)) for k in (9, 10))
    difference = a.astype(float) - b
    assert difference.std() > 1.2  # √2 · 56 electrons · gain
    assert abs(difference.mean()) < 0.05


def test_a_pixel_has_the_same_noise_in_a_rectangle_of_the_image() -> None:
    key = stream_key(11)
    (even, *_), frames = _flat(100.0, 6)
    whole = expose((even, even[None], even[None]), frames, 30.0, CAMERA, noise_key=key)
    cut = even[50:90, 100:300].copy()
    place = (50, 100, *even.shape)
    part = expose((cut, cut[None], cut[None]), frames, 30.0, CAMERA, noise_key=key, place=place)
    assert np.array_equal(part, whole[:, 50:90, 100:300])


def test_an_exposure_time_must_be_positive() -> None:
    with pytest.raises(InputError, match="above 0 ms"):
        expose(*_flat(1.0), 0.0, CAMERA, noise_key=stream_key(1))


@pytest.mark.parametrize(
    "change",
    [{"full_well_e": 0.0}, {"read_noise_e": -1.0}, {"prnu": np.nan}, {"black_level": 130.0}],
)
def test_impossible_electronics_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(SensorError, match="sensitivity and a full well above 0"):
        replace(CAMERA, **change)

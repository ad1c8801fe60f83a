import numpy as np
import pytest

from exposight.errors import ImageError
from exposight.imaging.response import light_of_levels, phase_correction


def test_grey_levels_are_light_by_default():
    assert light_of_levels(8) is None


def test_gamma():
    light = light_of_levels(10, gamma=2.0)
    assert light[[0, 512, 1023]] == pytest.approx([0, 512**2 / 1023, 1023])


def test_pairs_are_joined_by_lines_and_continued():
    light = light_of_levels(8, pairs=((0, 1.0), (100, 2.0), (200, 5.0)))
    top = 5.0 + 3.0 * 55 / 100
    assert light[[0, 50, 150, 255]] == pytest.approx(np.array([1, 1.5, 3.5, top]) * 255 / top)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"pairs": ((0, 0), (255, 1)), "gamma": 2}, "camera_response or camera_gamma, got both"),
        ({"pairs": ((0, 0),)}, "two or more pairs"),
        ({"pairs": ((10, 0), (255, 1))}, "from grey level 0"),
        ({"pairs": ((0, 0), (100, 1), (90, 2))}, "both rising"),
        ({"pairs": ((0, 0), (100, 1), (190, 1))}, "both rising"),
        ({"pairs": ((0, 0), (100, np.nan))}, "both rising"),
        ({"gamma": 0.0}, "camera_gamma must be from 0.1 to 10"),
    ],
)
def test_curves_that_no_camera_has(settings, message):
    with pytest.raises(ImageError, match=message):
        light_of_levels(8, **settings)


@pytest.mark.parametrize(
    ("steps_deg", "gamma", "contrast"),
    [((0, 120, 240), 2.2, 1.0), ((0, 90, 180, 270), 2.2, 0.9), ((120, 0, -120), 0.6, 0.7)],
)
def test_phases_of_a_gamma_are_taken_back(steps_deg, gamma, contrast):
    phase = np.linspace(-0.5, 0.5, 1001)[:-1]
    steps = np.radians(steps_deg)
    light = (0.5 + 0.5 * contrast * np.cos(2 * np.pi * phase[:, None] - steps)) ** gamma
    wave = light @ np.exp(1j * steps)  # equal steps
    measured = np.angle(wave) / (2 * np.pi)
    table = phase_correction(steps_deg, gamma, contrast)
    corrected = measured + np.interp(measured, np.linspace(-0.5, 0.5, table.size), table)
    error = (corrected - phase + 0.5) % 1.0 - 0.5
    assert np.abs(error).max() < 1e-5
    if len(steps_deg) == 3:
        assert np.abs((measured - phase + 0.5) % 1.0 - 0.5).max() > 0.01


def test_no_gamma_no_correction():
    assert np.abs(phase_correction((0, 120, 240), 1.0)).max() < 1e-12

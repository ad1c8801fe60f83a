"""Flat fields recover the numbers that a camera was made of, and say what they cannot recover."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import ExposureRange
from exposight.errors import SensorError
from exposight.twin.sensors import CameraElectronics, take_flat_fields

EXPOSURE = ExposureRange(min_ms=1.0, max_ms=1000.0, increment_ms=1.0)
ODD = CameraElectronics(
    bit_depth=12, black_level=30.0, prnu=0.02, full_well_e=10_000.0, read_noise_e=5.0
)


@pytest.mark.parametrize(
    "table",
    [ODD, replace(ODD, bit_depth=10, full_well_e=20_000.0, read_noise_e=25.0, pattern_seed=7)],
)
def test_odd_electronics_are_recovered(table):
    flats = take_flat_fields(table, EXPOSURE)
    assert flats.is_dark_resolved
    assert not flats.is_dark_clipped
    assert flats.black_level == pytest.approx(30.0, abs=0.02)
    assert flats.dark_noise_e == pytest.approx(table.read_noise_e, rel=0.02)
    assert flats.gain_dn_per_e == pytest.approx(table.gain, rel=0.002)
    assert flats.full_well_e == pytest.approx(table.full_well_e, rel=0.002)
    assert flats.prnu_percent == pytest.approx(2.0, rel=0.01)
    assert flats.dark_current_e_per_s == pytest.approx(125.0, rel=0.02)
    assert flats.linearity_error_percent < 0.02
    assert flats.dsnu_e < 0.02 * table.read_noise_e
    # Pixels of more than the mean sensitivity clip first.
    assert 0.92 * table.full_well_e < flats.saturation_e < table.full_well_e
    assert flats.snr_max == pytest.approx(np.sqrt(flats.saturation_e))
    least_e = np.hypot(table.read_noise_e, np.sqrt(1 / 12) / table.gain)
    assert flats.dynamic_range_db == pytest.approx(
        20 * np.log10(flats.saturation_e / (0.5 + np.hypot(0.5, least_e))), abs=0.2
    )


def test_noise_below_a_grey_level_comes_from_the_photon_transfer():
    flats = take_flat_fields(CameraElectronics(), EXPOSURE)  # 13 e⁻ are 0.24 grey levels
    assert not flats.is_dark_resolved
    assert flats.dark_noise_e == pytest.approx(13.0, rel=0.05)


def test_too_coarse_grey_levels_measure_no_gain():
    flats = take_flat_fields(CameraElectronics(full_well_e=1e6, black_level=0.0), EXPOSURE)
    assert flats.is_dark_clipped
    assert np.isnan([flats.gain_dn_per_e, flats.dark_noise_e, flats.dynamic_range_db]).all()
    assert flats.linearity_error_percent < 0.5


def test_one_exposure_time_alone_is_enough():
    only = ExposureRange(min_ms=20.0, max_ms=20.0, increment_ms=1.0)
    assert take_flat_fields(ODD, only).gain_dn_per_e == pytest.approx(ODD.gain, rel=0.002)


def test_a_camera_that_its_dark_current_fills():
    with pytest.raises(SensorError, match="dark current fills 9500 of 10000 e⁻"):
        take_flat_fields(replace(ODD, dark_current_e_per_s=9_500.0), EXPOSURE)

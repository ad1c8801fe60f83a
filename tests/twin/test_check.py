"""A simulated sensor measures itself: against its table, planes, and what a ring shows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from exposight.cell import ActiveSensor, ExposureRange, Projector
from exposight.errors import FormatError, SensorError
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.twin import SimulatedCellSettings
from exposight.twin.check import CheckedFigure, check_sensor

pytestmark = pytest.mark.slow

ODD = {
    "camera": {"bit_depth": 12, "black_level": 30, "prnu": 0.02, "read_noise_e": 6},
    "matt_white": {"grey_levels": 100, "exposure_ms": 20},
    "fringes": [1, 5, 23],
}


def small_sensor(n_cameras=1, **simulated):
    """Return a sensor with small images, lens distortion and a projector aside."""
    camera = PinholeCamera(
        width=320, height=240, fx=560.0, fy=560.0, cx=159.5, cy=119.5,
        distortion=(-0.1, 0.05, 0.0, 0.0, 0.0),
    )  # fmt: skip
    lamp = PinholeCamera(width=608, height=342, fx=600.0, fy=600.0, cx=303.5, cy=170.5)
    second = RigidTransform(translation_mm=np.array([60.0, 0.0, 0.0]))
    return ActiveSensor(
        name="small",
        cameras=(camera,) * n_cameras,
        first_from_camera=(RigidTransform(), second)[:n_cameras],
        projector=Projector(
            camera=lamp,
            camera_from_projector=RigidTransform.from_fanuc_wpr((130, 0, 0), 0.0, -18.0, 0.0),
        ),
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 400.0])),
        exposure=ExposureRange(min_ms=0.5, max_ms=200.0, increment_ms=0.1),
        working_distance_mm=(330.0, 480.0),
        simulated=simulated,
    )


@cache
def checked(n_cameras=1):
    table = ODD if n_cameras == 1 else {"matt_white": ODD["matt_white"]}
    return check_sensor(small_sensor(n_cameras, **table))


@pytest.mark.parametrize("n_cameras", [1, 2])
def test_a_sensor_does_what_its_table_says(n_cameras):
    check = checked(n_cameras)
    assert check.verdict.startswith("The simulated sensor does what its table says: all ")
    assert not check.deviating
    figures = {figure.name: figure for figure in check.figures}
    # 100 grey levels in 20 ms, of which the dark current is none to speak of
    assert figures["matt_white_grey_levels_per_ms"].measured == pytest.approx(5.0, rel=0.02)
    assert figures["prnu_percent"].measured == pytest.approx(100 * check.electronics.prnu, rel=0.02)


def test_the_noise_of_fringes_is_what_their_modulation_predicts():
    for plate in checked().plates:
        assert plate.repeat_noise_mm == pytest.approx(plate.predicted_noise_mm, rel=0.05)
        assert plate.noise_mm > 0.9 * plate.repeat_noise_mm
        assert plate.points_share > 0.99 * plate.covered_share


def test_a_stereo_sensor_predicts_no_noise_and_measures_what_both_cameras_see():
    check = checked(2)
    for plate in check.plates:
        assert np.isnan(plate.predicted_noise_mm)
        assert plate.points_share < plate.covered_share + 0.02
    assert plate.covered_share < 0.95
    assert any("cameras together cover" in remark for remark in check.remarks)


def test_the_ring_rises_and_falls_where_modulation_and_clipping_say():
    check = checked()
    rises, falls = check.ring.crossings(0.75)
    assert check.ring.plateau(0.75) == pytest.approx(1.0, abs=0.02)
    # 6 grey levels of modulation at a contrast of 0.9, blurred; full scale at 1.9 times the mean
    assert 30.0 + 6.0 / 0.9 < rises < 30.0 + 1.5 * 6.0 / 0.9
    assert falls == pytest.approx(30.0 + 225.0 / 1.9, rel=0.12)


def test_what_a_sensor_cannot_do_is_remarked():
    dark = replace(
        small_sensor(**ODD), exposure=ExposureRange(min_ms=0.1, max_ms=0.2, increment_ms=0.1)
    )
    check = check_sensor(dark)
    assert check.verdict.endswith("It measures no primer at the TCP.")
    remarks = " ".join(check.remarks)
    assert "matt white at the TCP does not clip: it has at most 1 grey levels" in remarks
    assert "p_norm never reaches 0.75" in remarks
    assert "At 400 mm at most 0 % of the pixels have a point: the longest exposure time" in remarks


def test_long_exposure_times_and_a_limit_of_the_noise_are_remarked():
    slow = ExposureRange(min_ms=100.0, max_ms=200.0, increment_ms=1.0)
    limited = small_sensor(**ODD, max_depth_noise_mm=0.01)
    check = check_sensor(replace(limited, exposure=slow))
    assert not check.deviating  # the dark current of 100 ms is in black level and dark noise
    remarks = " ".join(check.remarks)
    assert (
        "With exposure times of 100 to 200 ms, matt white at the TCP is always clipped." in remarks
    )
    assert "a depth noise of " in " ".join(check_sensor(limited).remarks)


def test_a_plans_table_goes_over_the_sensors():
    cell = SimulatedCellSettings(sensor={"camera": {"prnu": 0.05}})
    check = check_sensor(small_sensor(**ODD), cell)
    assert check.flat_fields.prnu_percent == pytest.approx(5.0, rel=0.02)


def test_a_deviation_is_worded():
    off = CheckedFigure(
        name="prnu_percent", label="PRNU", unit="%", measured=3.0, expected=2.0, tolerance=0.1
    )
    check = replace(checked(), figures=(off, *checked().figures[:3]))
    assert check.deviating == (off,)
    assert check.verdict == (
        "The simulated sensor deviates from its table in 1 of 4 figures: PRNU 3 in place of 2 %."
    )
    assert replace(off, measured=float("nan")).agrees is None


@pytest.mark.parametrize(
    ("simulated", "changes", "error", "message"),
    [
        ({"camera": {"full_well_e": -1}}, {}, FormatError, "full well above 0"),
        ({"camera": {"dark_current_e_per_s": 1e6}}, {}, SensorError, "dark current fills"),
        ({"camera": {"read_nose_e": 5}}, {}, FormatError, "read_nose_e"),
        (
            {},
            {"camera_from_tcp": RigidTransform(translation_mm=np.array([900.0, 0.0, 400.0]))},
            SensorError,
            "its TCP is not in its camera's image",
        ),
    ],
)
def test_an_impossible_sensor_is_refused(simulated, changes, error, message):
    with pytest.raises(error, match=message):
        check_sensor(replace(small_sensor(**simulated), **changes))

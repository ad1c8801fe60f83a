import pytest

from exposight.cell import PRESETS
from exposight.contradictions.rigs import axes_crossing, baseline
from exposight.geometry import RigidTransform


@pytest.mark.parametrize("distance_mm", [10.0, 65.0, 234.0, 3000.0])
def test_sensors_that_there_are(distance_mm):
    assert baseline(distance_mm, "camera and projector", (100.0, 1000.0)) is None


def test_metres_taken_for_millimetres():
    found = baseline(0.12, "camera and projector")
    assert found.is_error
    assert "0.12 mm apart" in found.found
    assert "in m? multiply it by 1000 (120 mm)" in found.explanation


def test_micrometres_taken_for_millimetres():
    found = baseline(120_000.0, "both cameras")
    assert found.is_error
    assert "in µm? divide it by 1000 (120 mm)" in found.explanation


@pytest.mark.parametrize("distance_mm", [0.0, float("nan"), 1e-9, 1e12])
def test_nothing_that_a_unit_explains(distance_mm):
    found = baseline(distance_mm, "both cameras")
    assert found.is_error
    assert "?" not in found.explanation


def test_a_triangle_too_flat_for_the_distance():
    found = baseline(4.7, "both cameras", (4000.0, 9000.0))
    assert found is not None
    assert not found.is_error


def crossing(translation_mm, turn_deg=-13.0, working_distance_mm=(400.0, 600.0)):
    pose = RigidTransform.from_fanuc_wpr(translation_mm, 0.0, turn_deg, 0.0)
    return axes_crossing(
        pose.rotation, pose.translation_mm, "camera and projector", working_distance_mm
    )


def test_axes_that_cross_where_the_sensor_measures():
    assert crossing((120.0, 0.0, 0.0)) is None
    assert crossing((120.0, 0.0, 0.0), turn_deg=0.5) is None  # parallel: they cross nowhere
    assert all(sensor.contradictions() == () for sensor in PRESETS.values())


@pytest.mark.parametrize(("scale", "unit"), [(0.1, "cm"), (1 / 25.4, "inches")])
def test_axes_that_cross_far_too_near(scale, unit):
    found = crossing((120.0 * scale, 0.0, 0.0))
    assert not found.is_error
    assert f"translation in {unit}?" in found.explanation


def test_axes_that_cross_behind():
    assert "wrong sign" in crossing((-120.0, 0.0, 0.0)).explanation

import pytest

from exposight.contradictions.rigs import baseline


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

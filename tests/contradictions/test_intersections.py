"""A camera and a projector 120 mm beside it before a tilted wall, and what is mistaken."""

import numpy as np
import pytest

from exposight.contradictions.intersections import Meeting, check_intersections
from exposight.geometry import RigidTransform


@pytest.fixture
def meeting():
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 60), np.linspace(-0.3, 0.3, 44))
    rays = np.dstack([x, y, np.ones_like(x)])
    depth = 520 / (1 - 0.12 * x - 0.05 * y)
    pose = RigidTransform.from_fanuc_wpr([120.0, 0.0, 0.0], 0.0, -13.0, 0.0).inverse()
    matrix = np.array([[1075.0, 0, 511.5], [0, 1075.0, 383.5], [0, 0, 1]])
    image = pose.apply(rays * depth[..., None]) @ matrix.T
    return Meeting(
        rays=rays[..., :2],
        column=image[..., 0] / image[..., 2],
        row=image[..., 1] / image[..., 2],
        rotation=pose.rotation,
        translation_mm=pose.translation_mm,
        matrix=matrix,
        size=(1024, 768),
    )


@pytest.mark.parametrize("without", [{}, {"row": None}])
def test_right_calibrations_are_quiet(meeting, without):
    assert check_intersections(meeting._replace(**without)) is None


@pytest.mark.parametrize("without", [{}, {"row": None}])
def test_the_mistake_that_explains_it_is_named(meeting, without):
    right = meeting._replace(**without)
    for wrong, named in (
        (right._replace(translation_mm=-right.translation_mm), "opposite sign"),
        (right._replace(rotation=right.rotation.T), "rotation transposed"),
        (right._replace(column=1023 - right.column), "columns mirrored"),
    ):
        found = check_intersections(wrong)
        assert found.is_error
        assert named in found.explanation


def test_unread_pixels_tell_nothing(meeting):
    nothing = np.full_like(meeting.column, np.nan)
    assert check_intersections(meeting._replace(column=nothing)) is None

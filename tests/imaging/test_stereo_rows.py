"""Rows of a rectified pair: what says that images and cameras do not fit, and what would."""

import numpy as np
import pytest
from tests.imaging.test_stereo import (
    BASELINE,
    CONVERGING,
    DEPTH_LIMITS,
    IDEAL,
    LEFT_LENS,
    RIGHT_LENS,
    Plane,
    _photos,
)

from exposight.errors import ContradictionError
from exposight.imaging import rectify, stereo_by_images
from exposight.imaging.stereo_rows import check_rows

LENSES = rectify(LEFT_LENS, RIGHT_LENS, CONVERGING)
ALIGNED = rectify(IDEAL, IDEAL, BASELINE)


def checked(images, pair, **words):
    return check_rows(*images, pair, depth_limits_mm=DEPTH_LIMITS, **words)


@pytest.mark.parametrize(("pair", "pose"), [(ALIGNED, BASELINE), (LENSES, CONVERGING)])
def test_rows_correspond(pair, pose):
    assert checked(_photos(Plane(), pair, pose), pair) is None


def test_images_without_texture_contradict_nothing():
    grey = np.full((180, 240), 90, np.uint8)
    assert checked((grey, grey), ALIGNED) is None
    noise = np.random.default_rng(1).integers(0, 255, (2, 180, 240), dtype=np.uint8)
    assert checked(noise, ALIGNED) is None


def test_swapped_images():
    left, right = _photos(Plane(), ALIGNED, BASELINE)
    found = checked((right, left), ALIGNED)
    assert found.is_error
    assert "swapping both images fits" in found.explanation


@pytest.mark.parametrize("rows", [3, -5])
def test_one_image_shifted(rows):
    left, right = _photos(Plane(), ALIGNED, BASELINE)
    found = checked((left, np.roll(right, rows, axis=0)), ALIGNED)
    assert f"lies {abs(rows)}.0 px off its row" in found.found
    assert "belong together" in found.explanation


def test_rectified_images_taken_for_raw():
    turned = LENSES.turn(*_photos(Plane(), LENSES, CONVERGING))
    images = [np.ascontiguousarray(each[:180, :240]) for each in turned]
    found = checked(images, rectify(LEFT_LENS, LEFT_LENS, CONVERGING))
    assert found.is_error
    assert "taking the images as rectified already (--rectified) fits" in found.explanation


def test_raw_images_taken_for_rectified():
    images = [each[:180, :240] for each in _photos(Plane(), LENSES, CONVERGING)]
    found = checked(images, ALIGNED)
    assert found.is_error
    assert "px off its row" in found.found


def test_what_else_the_cameras_may_be_is_tried():
    images = _photos(Plane(), ALIGNED, BASELINE)
    wrong = rectify(LEFT_LENS, LEFT_LENS, CONVERGING)
    found = checked(images, wrong, others={"--rectified": ALIGNED})
    assert found.explanation.startswith(("--rectified fits", "taking the images as rectified"))


def test_matching_refuses_them_unless_told():
    left, right = _photos(Plane(), ALIGNED, BASELINE)
    words = {"depth_limits_mm": DEPTH_LIMITS}
    with pytest.raises(ContradictionError, match="swapping both images"):
        stereo_by_images(right, left, ALIGNED, **words)
    match = stereo_by_images(right, left, ALIGNED, **words, despite=("rows",))
    assert [each.check for each in match.contradictions] == ["rows"]
    assert sum(match.counts().values()) == left.size

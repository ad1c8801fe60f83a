"""Pictures of captures: marks where they belong, rings in the colour of their quality."""

import base64
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from exposight.report.palette import (
    CLIPPED,
    P_NORM_SCALE,
    feature_style,
    rgb,
    scale_rgb,
)
from exposight.report.pictures import (
    brighten,
    close_picture,
    marked_picture,
    picture,
    ringed_picture,
)


@pytest.fixture
def view(report):
    return report.view


def test_brightening_keeps_black_white_and_order():
    grey = np.arange(256, dtype=np.uint8)
    shown = brighten(grey)
    assert shown[[0, 255]].tolist() == [0.0, 255.0]
    assert (np.diff(shown) > 0).all()


def test_clipped_pixels_are_red_and_pixels_without_a_point_blueish(view):
    capture = view.captures[2]
    marked = marked_picture(capture)
    clipped = capture.image == 255
    assert (marked[clipped] == rgb(CLIPPED)).all()
    missing = ~capture.cloud.valid & ~clipped
    plain = marked_picture(replace(capture, cloud=None))
    assert (marked[missing][:, 2] > marked[missing][:, 0]).all()
    np.testing.assert_array_equal(marked[~missing], plain[~missing])


def test_a_ring_has_the_colour_of_its_quality(view):
    marked = np.zeros((*view.captures[0].image.shape, 3), dtype=np.uint8)
    p_norm = np.array([0.0, 1.0, np.nan, 1.0])
    ringed = ringed_picture(marked, view.views, p_norm)
    colours = {tuple(own) for own in ringed.reshape(-1, 3).tolist()}
    assert {tuple(scale_rgb(P_NORM_SCALE, own).astype(int)) for own in (0.0, 1.0)} <= colours


def test_a_picture_is_small_enough_for_a_page(view):
    marked = cv2.resize(marked_picture(view.captures[1]), None, fx=40, fy=40)
    views = [
        SimpleNamespace(feature=each.feature, rows=40 * each.rows, columns=40 * each.columns)
        for each in view.views
    ]
    assert ringed_picture(marked, views, view.p_norm[:, 1]).shape[1] == 1000


def test_a_close_picture_is_the_features_neighbourhood(view):
    whole = marked_picture(view.captures[1])
    mask = view.views[3]
    close = close_picture(whole, mask, 1.0)
    row, column = int(mask.rows.mean()), int(mask.columns.mean())
    assert close.shape[1] == 340
    assert (close == whole[row, column]).all(axis=2).any()


@pytest.mark.parametrize("photo", [True, False])
def test_pictures_are_decoded_as_they_were(photo):
    pixels = np.full((8, 12, 3), (200, 30, 60), dtype=np.uint8)
    own = picture(pixels, "t", "a", photo=photo)
    data = base64.b64decode(own.address.partition(",")[2])
    decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert (own.width, own.height) == (12, 8)
    np.testing.assert_allclose(decoded, pixels, atol=4 if photo else 0)


def test_a_scales_ends_and_middle_are_its_colours():
    colours = scale_rgb(P_NORM_SCALE, [-1.0, 0.0, 0.5, 1.0, 2.0])
    low, high = [68, 1, 84], [253, 231, 37]
    assert colours.tolist() == [low, low, [33, 145, 140], high, high]


def test_every_feature_of_the_paper_has_its_own_colour_and_unseen_ones_open_marks():
    names = [f"f{n}" for n in range(1, 10)]
    names += [f"f{n}_test" for n in range(1, 5)] + [f"f{n}_out" for n in range(1, 6)]
    assert len({feature_style(name).colour for name in names}) == len(names)
    assert feature_style("f1").filled
    assert not feature_style("f1_test").filled

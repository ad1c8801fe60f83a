import base64
from dataclasses import replace

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from exposight.report.colours import CLIPPED, P_NORM_SCALE, rgb, scale_rgb
from exposight.report.images import brighten, marked_picture, mask_edge
from exposight.report.skull.images import ring_picture
from exposight.report.skull.selection import object_crop


def test_brightening_keeps_black_and_white_and_lifts_the_dark():
    np.testing.assert_allclose(brighten(np.array([0, 51, 255], np.uint8)), [0, 114.04, 255], 1e-4)


def test_clipped_pixels_are_red_and_no_others(result):
    bright = result.sweep[-1]
    red = (marked_picture(bright) == rgb(CLIPPED)).all(axis=-1)
    np.testing.assert_array_equal(red, bright.image == 255)


def test_pixels_with_a_point_stay_grey_and_those_without_turn_blue(result):
    dark = result.sweep[0]
    picture = marked_picture(dark).astype(int)
    grey = (picture[..., 0] == picture[..., 1]) & (picture[..., 1] == picture[..., 2])
    np.testing.assert_array_equal(grey, dark.cloud.valid)
    assert (picture[..., 2] > picture[..., 0])[~dark.cloud.valid].all()


def test_rings_take_the_colour_of_their_p_norm(result):
    picture = ring_picture(result)
    view = result.views[1]
    edge = mask_edge(view.rows, view.columns)
    colour = picture[view.rows[edge], view.columns[edge]].mean(axis=0)
    # the edge is drawn nearly opaque, over p_norm = 1 at the nominal exposure
    np.testing.assert_allclose(colour, scale_rgb(P_NORM_SCALE, 1.0), atol=15)


def test_what_is_no_ring_stays_grey(result):
    picture = ring_picture(result)
    outside = np.ones(picture.shape[:2], dtype=bool)
    for view in result.views:
        outside[view.rows, view.columns] = False
    assert (np.ptp(picture[outside].astype(int), axis=1) == 0).all()


@settings(max_examples=30)
@given(arrays(np.bool_, (6, 7), elements=st.booleans()).filter(np.any))
def test_the_edge_is_where_a_neighbour_is_outside(mask):
    rows, columns = np.nonzero(mask)
    padded = np.pad(mask, 1)
    neighbours = [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
    expected = ~np.logical_and.reduce(neighbours)
    np.testing.assert_array_equal(mask_edge(rows, columns), expected[rows, columns])


def test_pictures_are_cropped_to_the_object_at_full_resolution(result, read_page):
    crop = object_crop(result)
    images = [attributes for tag, attributes in read_page.tags if tag == "img"]
    assert len(images) == 1 + len(result.sweep)
    for attributes in images:
        data = base64.b64decode(attributes["src"].partition(",")[2])
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (crop.height, crop.width, 3)
        assert (attributes["width"], attributes["height"]) == (str(crop.width), str(crop.height))
        assert attributes["alt"]


def test_the_picture_with_rings_is_lossless(result, read_page):
    source = next(attributes["src"] for tag, attributes in read_page.tags if tag == "img")
    data = base64.b64decode(source.removeprefix("data:image/png;base64,"))
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(picture, object_crop(result).of(ring_picture(result)))


def test_deeper_images_look_like_8_bit_ones(result):
    capture = result.sweep[0]
    deep = replace(capture, image=capture.image.astype(np.uint16) * 257, bit_depth=16)
    np.testing.assert_array_equal(marked_picture(deep), marked_picture(capture))

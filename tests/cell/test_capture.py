from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import Cloud
from exposight.errors import CloudError, ImageError, InputError, SensorError


def grey(dtype, value=100):
    return np.full((12, 16), value, dtype=dtype)


@pytest.mark.parametrize(
    ("image", "bit_depth", "message"),
    [
        (np.zeros((12, 16, 3), np.uint8), 8, r"got a colour image of shape \(12, 16, 3\)"),
        (grey(np.uint16), 8, "expected 8 bits in uint8, got uint16; say its true bit depth"),
        (grey(np.uint8), 16, "expected 16 bits in uint16, got uint8"),
        (grey(np.uint16, 4096), 12, "12 bits go up to 4095, got 4096; .*right by 4"),
        (grey(np.uint16, 1024), 10, "10 bits go up to 1023, got 1024; .*right by 6"),
        (grey(np.float64), 8, "in uint8, got float64"),
        (grey(np.uint16), 17, "a bit depth must be a whole number from 8 to 16, got 17"),
        (np.zeros((0, 16), np.uint8), 8, "needs a grey image"),
    ],
)
def test_an_image_that_is_not_what_it_is_said_to_be_is_refused(
    make_capture, image, bit_depth, message
):
    with pytest.raises(ImageError, match=message):
        replace(make_capture(), image=image, bit_depth=bit_depth)


@pytest.mark.parametrize(("bit_depth", "white"), [(10, 1023), (12, 4095), (16, 65535)])
def test_grey_levels_are_scaled_to_255(make_capture, bit_depth, white):
    image = np.linspace(0, white, 12 * 16).astype(np.uint16).reshape(12, 16)
    levels = replace(make_capture(), image=image, bit_depth=bit_depth).grey_levels()
    np.testing.assert_allclose(levels, image * (255 / white), rtol=1e-6)
    assert levels.max() == pytest.approx(255)


def test_grey_levels_of_8_bits_are_the_image(make_capture):
    capture = make_capture()
    levels = capture.grey_levels()
    assert levels.dtype == np.uint8
    np.testing.assert_array_equal(levels, capture.image)


def test_a_capture_keeps_its_image_when_the_cameras_buffer_is_filled_again(make_capture):
    buffer = grey(np.uint8)
    capture = replace(make_capture(), image=buffer)
    buffer[:] = 0
    assert (capture.image == 100).all()


@pytest.mark.parametrize("exposure", [0.0, -3.0, float("nan"), float("inf")])
def test_an_exposure_must_be_positive(make_capture, exposure):
    with pytest.raises(InputError, match="exposure time must be above 0 ms, got"):
        replace(make_capture(), exposure_ms=exposure)


def test_a_view_needs_a_name(make_capture):
    with pytest.raises(InputError, match="needs the name of its view"):
        replace(make_capture(), view="")


@pytest.mark.parametrize("name", ["../a.txt", "", ".hidden", "image.png"])
def test_an_attachment_needs_a_name_of_its_own(make_capture, name):
    with pytest.raises(InputError, match="an attachment needs a file name"):
        replace(make_capture(), attachments={name: b""})


def test_a_capture_of_the_sensor_fits(make_capture, sensor):
    make_capture().check_fits(sensor)


def test_an_image_of_another_size_does_not_fit(make_capture, sensor):
    capture = replace(make_capture(), image=np.zeros((16, 12), np.uint8))
    with pytest.raises(ImageError, match=r"'v1' at 10 ms: .* 12 rows × 16 columns, got 16 × 12"):
        capture.check_fits(sensor)


def test_a_cloud_organised_otherwise_does_not_fit(make_capture, sensor):
    capture = replace(make_capture(), cloud=Cloud(points=np.ones((6, 9, 3))))
    with pytest.raises(CloudError, match="or half, a third, … of both, got 6 × 9"):
        capture.check_fits(sensor)


@pytest.mark.parametrize("ratio", [2, 4])
def test_a_cloud_at_a_fraction_of_the_resolution_fits(make_capture, sensor, ratio):
    cloud = Cloud(points=np.ones((12 // ratio, 16 // ratio, 3)))
    replace(make_capture(), cloud=cloud).check_fits(sensor)


def test_an_unorganised_cloud_fits(make_capture, sensor):
    replace(make_capture(), cloud=Cloud(points=np.ones((7, 3)))).check_fits(sensor)


def test_an_exposure_that_the_sensor_cannot_take_does_not_fit(make_capture, sensor):
    with pytest.raises(SensorError, match="from 1 to 1000 ms, got 1500 ms"):
        make_capture(1500.0).check_fits(sensor)

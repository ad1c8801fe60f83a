"""Stack images: kept with a capture, written and read, and refused where they contradict it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from exposight import files
from exposight.cell import CampaignFolder, CampaignWriter, StackImages
from exposight.cell.capture import _FORMAT, read_capture, write_capture
from exposight.errors import DamagedFileError, FormatError, ImageError, InputError, MissingFileError


def image(value, dtype=np.uint8, shape=(12, 16)):
    return np.full(shape, value, dtype=dtype)


def stack_of(dtype=np.uint8, **changes):
    images = {
        "mean": image(90, dtype),
        "maximum": image(200, dtype),
        "modulation": image(61, dtype),
    }
    return StackImages(**{**images, "min_modulation": 18.5, **changes})


@pytest.mark.parametrize(
    ("stack", "source"),
    [
        (stack_of(), "stripe"),
        (stack_of(mean=None), "stripes-mean"),
        (stack_of(min_modulation=None), "dots"),
        (None, "texture"),
    ],
)
def test_what_is_written_is_read(tmp_path, make_capture, sensor, part, stack, source):
    capture = replace(make_capture(), stack=stack, brightness_source=source)
    with CampaignWriter.open_or_create(tmp_path, name="c", sensor=sensor, part=part) as writer:
        writer.add(capture)
    (read,) = CampaignFolder(tmp_path).captures()
    assert read.brightness_source == source
    if stack is None:
        assert read.stack is None
        return
    assert read.stack.min_modulation == stack.min_modulation
    assert read.stack.images().keys() == stack.images().keys()
    for name, pixels in read.stack.images().items():
        np.testing.assert_array_equal(pixels, stack.images()[name])


def test_deep_stacks_come_back(tmp_path, make_capture):
    stack = stack_of(np.uint16, maximum=image(4095, np.uint16))
    capture = replace(make_capture(), image=image(1000, np.uint16), bit_depth=12, stack=stack)
    write_capture(tmp_path / "c", capture)
    read = read_capture(tmp_path / "c").stack
    assert read.maximum.dtype == np.uint16
    np.testing.assert_array_equal(read.maximum, stack.maximum)


def test_a_capture_keeps_its_stack_when_the_buffer_is_filled_again(make_capture):
    buffer = image(200)
    capture = replace(make_capture(), stack=stack_of(maximum=buffer))
    buffer[:] = 0
    assert (capture.stack.maximum == 200).all()
    with pytest.raises(ValueError, match="read-only"):
        capture.stack.maximum[0, 0] = 1


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"stack": stack_of(modulation=image(1, shape=(16, 12)))}, ImageError,
         "'modulation' must have the 12 rows × 16 columns .* got 16 × 12"),
        ({"stack": stack_of(maximum=image(1, np.uint16))}, ImageError,
         "'maximum': expected 8 bits in uint8, got uint16"),
        ({"stack": stack_of(), "brightness_source": "stripes-mean"}, InputError,
         "has another mean"),
        ({"brightness_source": "stripes"}, InputError,
         "brightness_source must be one of .*, got 'stripes'"),
        ({"stack": stack_of(), "attachments": {"mean.png": b""}}, InputError, "attachment needs"),
    ],
)  # fmt: skip
def test_contradictions_are_refused(make_capture, changes, error, message):
    with pytest.raises(error, match=message):
        replace(make_capture(), **changes)


@pytest.mark.parametrize("limit", [-1.0, 256.0, float("nan")])
def test_a_limit_that_is_no_grey_level_is_refused(limit):
    with pytest.raises(InputError, match="min_modulation must be from 0 to 255"):
        stack_of(min_modulation=limit)


def test_an_older_captures_attachment_may_have_a_stack_images_name(tmp_path, make_capture):
    write_capture(tmp_path / "c", replace(make_capture(), attachments={"mean.png": b"mine"}))
    assert read_capture(tmp_path / "c").attachments["mean.png"] == b"mine"


# -- on disk ------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, make_capture):
    write_capture(tmp_path / "c", replace(make_capture(), stack=stack_of()))
    return tmp_path / "c"


def test_a_stack_image_that_is_damaged_or_gone_is_named(folder):
    content = bytearray((folder / "maximum.png").read_bytes())
    content[-20] ^= 1
    (folder / "maximum.png").write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"maximum\.png"):
        read_capture(folder)
    (folder / "maximum.png").unlink()
    with pytest.raises(MissingFileError, match=r"maximum\.png"):
        read_capture(folder)


def test_a_stack_image_of_another_size_is_refused_when_it_is_read(folder):
    png = cv2.imencode(".png", image(3, shape=(6, 8)))[1].tobytes()
    (folder / "modulation.png").write_bytes(png)
    path = folder / "capture.json"
    description = _FORMAT.unseal(path.read_bytes(), "it")
    stack = replace(description.stack, modulation_sha256=files.sha256_of(png))
    path.write_bytes(_FORMAT.seal(replace(description, stack=stack)))
    with pytest.raises(FormatError, match="'modulation' must have the 12 rows"):
        read_capture(folder)

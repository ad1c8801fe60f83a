import struct
from zlib import compress, crc32

import cv2
import numpy as np
import pytest

from exposight.cell import is_depth_image, read_depth
from exposight.cell.image_files import decoded_image
from exposight.errors import FormatError, ImageError, MissingFileError
from exposight.files import collected_remarks
from exposight.imaging import read_frames

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)


def written(path, image, suffix):
    """Write an image of a type into a file that may be called otherwise."""
    path.write_bytes(cv2.imencode(suffix, image)[1].tobytes())
    return path


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".pgm"])
def test_images_are_known_by_their_content(tmp_path, suffix):
    path = written(tmp_path / "frame.jpg", GREY, suffix)
    np.testing.assert_array_equal(read_frames([path]).frames[0], GREY)


def test_jpeg_is_read_and_said_once(tmp_path):
    paths = [written(tmp_path / f"{i}.png", GREY, ".jpg") for i in range(3)]
    with collected_remarks() as remarks:
        read_frames(paths)
    (said,) = remarks
    assert "JPEG, whose compression changes grey levels" in said


@pytest.mark.parametrize(
    ("name", "pattern"),
    [("IMG_1.TIF", "*.tiff"), ("Frame_1.tif", "frame_*.TIF"), ("a.jpeg", "*.jpg")],
)
def test_frames_whose_names_differ_in_capitals_or_their_twin_suffix_are_said(
    tmp_path, name, pattern
):
    written(tmp_path / name, GREY, ".png")
    with collected_remarks() as remarks:
        assert len(read_frames(tmp_path, pattern=pattern).frames) == 1
    assert f"frames such as {name}, for none matches {pattern}" in "".join(remarks)
    with pytest.raises(MissingFileError, match="no frame matches"):
        read_frames(tmp_path, pattern="*.bmp")


def test_opacity_is_left_out(tmp_path):
    opaque = np.full_like(GREY, 255)
    path = written(tmp_path / "a.png", np.dstack([GREY, GREY, GREY, opaque]), ".png")
    np.testing.assert_array_equal(read_frames([path]).frames[0], GREY)


def png_with_palette(levels, palette):
    """Return a PNG of 8 bits whose levels are places in a palette."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc32(kind + data))

    rows = b"".join(b"\0" + row.tobytes() for row in levels)
    head = struct.pack(">IIBBBBB", levels.shape[1], levels.shape[0], 8, 3, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        chunk(kind, data)
        for kind, data in (
            *(
                (b"IHDR", head),
                (b"PLTE", bytes(palette)),
                (b"IDAT", compress(rows)),
                (b"IEND", b""),
            ),
        )
    )


def test_a_palette_of_greys_is_read_and_one_of_colours_refused(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(png_with_palette(GREY, [5 * i for i in range(48) for _ in "rgb"]))
    np.testing.assert_array_equal(read_frames([path]).frames[0], 5 * GREY)
    path.write_bytes(png_with_palette(GREY, [k for i in range(48) for k in (i, 0, 255 - i)]))
    with pytest.raises(ImageError, match="3 different channels"):
        read_frames([path])


def test_a_tiff_of_several_pages_is_refused(tmp_path):
    path = tmp_path / "stack.tif"
    cv2.imwritemulti(str(path), [GREY, GREY, GREY])
    with pytest.raises(ImageError, match=r"stack\.tif: a TIFF of 3 pages.*save each"):
        read_frames([path])


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".jpg"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.6, 0.95])
def test_a_truncated_image_is_refused(tmp_path, suffix, share):
    rng = np.random.default_rng(0)
    path = written(tmp_path / "a", rng.integers(0, 255, (60, 80), np.uint8), suffix)
    data = path.read_bytes()
    with pytest.raises(ImageError, match="it may be truncated"):
        decoded_image(data[: int(share * len(data))], path)


def test_depth_images_are_known_by_their_content(tmp_path):
    depth = np.arange(48, dtype=np.uint16).reshape(6, 8)
    path = written(tmp_path / "depth.dat", depth, ".png")
    assert is_depth_image(path)
    assert read_depth(path)[1, 0] == 8
    np.save(tmp_path / "depth.npy", depth)
    (tmp_path / "depth.npy").rename(tmp_path / "depth.png")
    assert not is_depth_image(tmp_path / "missing.npy")
    assert is_depth_image(tmp_path / "depth.png")
    assert read_depth(tmp_path / "depth.png")[1, 0] == 8
    (tmp_path / "cloud.png").write_bytes(b"ply\nformat ascii 1.0\n")
    assert not is_depth_image(tmp_path / "cloud.png")
    with pytest.raises(FormatError, match="of 8 bits or in colour, hold none"):
        read_depth(written(tmp_path / "picture.png", GREY, ".png"))


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".bmp"])
def test_damaged_images_are_said_by_us_alone(tmp_path, capfd, suffix):
    path = written(tmp_path / "a.png", GREY, suffix)
    data = path.read_bytes()
    damaged = data[:-16] + bytes([data[-16] ^ 1]) + data[-15:] if suffix == ".png" else data[:-20]
    path.write_bytes(damaged)
    with pytest.raises(ImageError, match="cannot be read as an image"):
        read_frames([path])
    assert capfd.readouterr().err == ""

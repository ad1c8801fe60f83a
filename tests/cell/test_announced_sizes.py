"""Images and clouds whose headers announce what their bytes do not hold are refused unread."""

import struct
from zlib import crc32

import cv2
import numpy as np
import pytest

from exposight.cell import read_cloud
from exposight.cell.image_files import decoded_image
from exposight.errors import DamagedFileError, ExposightError, FormatError, ImageError

GREY = np.arange(48, dtype=np.uint8).reshape(6, 8)
PLY = (
    "ply\nformat ascii 1.0\n{}element vertex 1\nproperty float x\nproperty float y\n{}end_header\n"
)


def encoded(suffix):
    return cv2.imencode(suffix, GREY)[1].tobytes()


def png_of(rows, columns):
    data = encoded(".png")
    head = b"IHDR" + struct.pack(">II", columns, rows) + data[24:29]
    return data[:12] + head + struct.pack(">I", crc32(head)) + data[33:]


@pytest.mark.parametrize(
    ("data", "fact"),
    [
        (png_of(30_000, 30_000), "up to 400000000 pixels"),
        (png_of(15_000, 15_000), "more than .* bytes can hold"),
        (
            encoded(".bmp")[:18] + struct.pack("<ii", 20_000, 20_000) + encoded(".bmp")[26:],
            "more than .* bytes can hold|up to",
        ),
        (encoded(".jpg")[:-2], "truncated"),
        (encoded(".png")[:-12], "truncated"),
        (encoded(".tif")[:-3], "truncated"),
    ],
)
def test_images_are_held_against_their_bytes(tmp_path, data, fact):
    with pytest.raises(ImageError, match=fact):
        decoded_image(data, tmp_path / "a")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("element vertex 1\nproperty float z\n", ""),
        ("obj_info num_cols 1\nobj_info num_cols 2\n", "property float z\n"),
        ("format binary_little_endian 1.0\n", "property float z\n"),
        ("", "property float z\nproperty float y\n"),
        ("", "".join(f"property float a{k}\n" for k in range(2000)) + "property float z\n"),
    ],
)
def test_a_ply_header_says_a_thing_once_and_little(tmp_path, before, after):
    path = tmp_path / "a.ply"
    path.write_text(PLY.format(before, after) + "1 2 3\n")
    with pytest.raises(FormatError, match=r"a\.ply"):
        read_cloud(path)


def test_a_ply_with_more_points_than_announced_is_refused(tmp_path):
    header = PLY.format("", "property float z\n").replace("ascii", "binary_little_endian")
    path = tmp_path / "a.ply"
    path.write_bytes(header.encode() + np.ones((2, 3), "<f4").tobytes())
    with pytest.raises(DamagedFileError, match="12 bytes follow all that its header announces"):
        read_cloud(path)


@pytest.mark.parametrize("line", ["WIDTH -1", "WIDTH 1_0", "POINTS 7", "COUNT 1 1 99999999999"])
def test_a_pcd_header_is_held_against_itself(tmp_path, line):
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n"
    path = tmp_path / "a.pcd"
    path.write_text(f"{head}{line}\nDATA ascii\n1 2 3\n")
    with pytest.raises(ExposightError, match=r"a\.pcd"):
        read_cloud(path)

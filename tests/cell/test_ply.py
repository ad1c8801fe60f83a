from pathlib import Path

import numpy as np
import pytest

from exposight.cell.ply import ply_from_points, points_from_ply
from exposight.errors import DamagedFileError, FormatError

PATH = Path("scan.ply")
XYZ = "property float x\nproperty float y\nproperty float z\n"


def ply(body: str, *, vertices: int, properties: str = XYZ, before: str = "") -> bytes:
    header = f"ply\nformat ascii 1.0\n{before}element vertex {vertices}\n{properties}end_header\n"
    return (header + body).encode()


def test_a_scanners_size_makes_the_cloud_organised():
    data = ply(
        "1 2 3\n4 5 6\n7 8 9\n0 0 1\n0 1 0\n1 0 0\n",
        vertices=6,
        before="obj_info num_cols 3\nobj_info num_rows 2\nobj_info made by a scanner\n",
    )
    points, sigma = points_from_ply(data, PATH)
    assert sigma is None
    assert points.shape == (2, 3, 3)
    assert points[1, 0].tolist() == [0, 0, 1]


def test_other_properties_and_elements_are_skipped():
    data = ply(
        "9\n8\n0.5 1 2 3\n0.6 4 nan 6\n3 0 1 1\n",
        vertices=2,
        before="comment of a program\nelement camera 2\nproperty int id\n",
        properties="property double confidence\n"
        + XYZ
        + "element face 1\nproperty list uchar int vertex_indices\n",
    )
    np.testing.assert_array_equal(points_from_ply(data, PATH)[0], [[1, 2, 3], [4, np.nan, 6]])


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_both_byte_orders_are_read(byte_order):
    sign = "<" if byte_order == "little" else ">"
    header = (
        f"ply\r\nformat binary_{byte_order}_endian 1.0\r\nelement camera 3\r\n"
        "property ushort id\r\nelement vertex 2\r\nproperty uchar red\r\nproperty double x\r\n"
        "property float y\r\nproperty int z\r\nend_header\r\n"
    )
    vertices = np.zeros(
        2, dtype=[("r", "u1"), ("x", f"{sign}f8"), ("y", f"{sign}f4"), ("z", f"{sign}i4")]
    )
    vertices["x"], vertices["y"], vertices["z"] = [1, 4], [2, 5], [3, 6]
    data = header.encode() + bytes(6) + vertices.tobytes()
    assert points_from_ply(data, PATH)[0].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_the_size_is_written_as_scanners_do():
    data = ply_from_points(np.ones((2, 3, 3), np.float32))
    assert b"obj_info num_cols 3\nobj_info num_rows 2\nelement vertex 6\n" in data


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        (b"solid", FormatError, "must begin with the line 'ply'"),
        (b"ply\nformat ascii 1.0\n", DamagedFileError, "no line 'end_header'"),
        (b"ply\nend_header\n", FormatError, "no format line"),
        (b"ply\nformat ascii 1.0\nend_header\n", FormatError, "expected an element 'vertex'"),
        (b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n", FormatError, "element vertex x"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", FormatError, "property float x"),
        (b"ply\nformat martian 1.0\nend_header\n", FormatError, "unknown line 'format martian"),
        (ply("1 2\n", vertices=1, properties=XYZ[:-17]), FormatError, "with x, y and z, got x, y"),
        (ply("1 2 3\n", vertices=2), DamagedFileError, "announces 2 vertices, it holds 1"),
        (ply("1 2 three\n", vertices=1), FormatError, "a vertex cannot be read"),
        (ply("1 2\n", vertices=1), FormatError, "a vertex cannot be read"),
        (
            ply("1 1 2 3\n", vertices=1, properties="property list uchar int n\n" + XYZ),
            FormatError,
            "holds the list 'n'",
        ),
        (
            ply("1 2 3\n", vertices=1, before="obj_info num_cols 2\nobj_info num_rows 2\n"),
            FormatError,
            "2 rows × 2 columns .* need 4 vertices, got 1",
        ),
    ],
)
def test_what_is_wrong_is_said(data, error, message):
    with pytest.raises(error, match=message) as caught:
        points_from_ply(data, PATH)
    assert "scan.ply" in str(caught.value)


def test_a_binary_file_that_is_cut_off_says_how_much_is_there():
    data = ply_from_points(np.ones((4, 3), np.float32))[:-1]
    with pytest.raises(DamagedFileError, match="announces 4 vertices, it holds 3"):
        points_from_ply(data, PATH)


def test_standard_deviations_are_a_property_of_their_own():
    points, sigma = np.ones((2, 3, 3), np.float32), np.arange(6, dtype=np.float32).reshape(2, 3)
    data = ply_from_points(points, sigma)
    assert b"property float z\nproperty float sigma_z\nend_header\n" in data
    back, sigma_back = points_from_ply(data, PATH)
    np.testing.assert_array_equal(back, points)
    np.testing.assert_array_equal(sigma_back, sigma)
    text = ply(
        "1 2 0.5 3\n", vertices=1, properties=XYZ.replace("z\n", "sigma_z\nproperty float z\n")
    )
    back, sigma_back = points_from_ply(text, PATH)
    assert back.tolist() == [[1, 2, 3]]
    assert sigma_back.tolist() == [0.5]

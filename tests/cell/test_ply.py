import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from exposight.cell.cloud_formats.ply import ply_from_points, points_from_ply
from exposight.errors import DamagedFileError, FormatError
from exposight.files import collected_remarks

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
        (ply("1 2 3\n4 5", vertices=2), DamagedFileError, "announces 2 vertices, it holds 1"),
        (ply("1 2 three\n", vertices=1), FormatError, "a vertex cannot be read"),
        (ply("1 2\n", vertices=1), FormatError, "a vertex cannot be read"),
        (
            ply("1 1 2 3\n", vertices=1, properties="property list uchar int n\n" + XYZ),
            DamagedFileError,
            "announces 1 vertices, it holds 0",
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


# -- as other programs write them ----------------------------------------------------------------

LISTS = "element face 2\nproperty list uchar int vertex_indices\n"


def encoded(kind, header, rows):
    """Return a PLY file whose body is written in text or binary; `rows` are (types, numbers)."""
    text = f"ply\nformat {kind} 1.0\n{header}end_header\n".encode()
    if kind == "ascii":
        return text + "".join(" ".join(map(str, numbers)) + "\n" for _, numbers in rows).encode()
    sign = "<" if "little" in kind else ">"
    return text + b"".join(struct.pack(sign + types, *numbers) for types, numbers in rows)


KINDS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_range_grid_gives_each_pixel_its_vertex(kind):
    header = (
        f"obj_info num_cols 3\nobj_info num_rows 2\nelement vertex 2\n{XYZ}"
        "element range_grid 6\nproperty list uchar int vertex_indices\n"
    )
    empty, rows = ("B", [0]), [("fff", [1, 2, 3]), ("fff", [4, 5, 6])]
    grid = [empty, ("Bi", [1, 1]), empty, empty, empty, ("Bi", [1, 0])]
    points, _ = points_from_ply(encoded(kind, header, [*rows, *grid]), PATH)
    expected = np.full((2, 3, 3), np.nan)
    expected[0, 1], expected[1, 2] = [4, 5, 6], [1, 2, 3]
    np.testing.assert_array_equal(points, expected)


@pytest.mark.parametrize("kind", KINDS)
def test_lists_of_any_length_are_walked(kind):
    header = LISTS + "element vertex 2\nproperty list uchar short n\nproperty float quality\n" + XYZ
    rows = [
        *(("Biii", [3, 0, 1, 2]), ("Bi", [1, 7])),
        *(("Bhffff", [1, 9, 0.5, 1, 2, 3]), ("Bffff", [0, 0.5, 4, 5, 6])),
    ]
    assert points_from_ply(encoded(kind, header, rows), PATH)[0].tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("kind", KINDS)
def test_a_list_that_reaches_beyond_the_file_is_damage(kind):
    header = "element vertex 1\nproperty list uint int n\n" + XYZ
    rows = [("Iifff", [4_000_000_000, 0, 1, 2, 3])]
    with pytest.raises(DamagedFileError, match="announces 1 vertices, it holds 0"):
        points_from_ply(encoded(kind, header, rows), PATH)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("properties", [XYZ, "property list uchar int n\n" + XYZ])
def test_counts_beyond_the_file_allocate_nothing(kind, properties):
    header = f"element vertex 900000000000\n{properties}"
    with pytest.raises(DamagedFileError, match="announces 900000000000 vertices"):
        points_from_ply(encoded(kind, header, [("fff", [1, 2, 3])]), PATH)


@pytest.mark.parametrize(
    "spelling",
    ["nan", "NaN", "-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND00", "1.#INF", "-1.#J", "-inf"],
)
def test_every_spelling_of_nan_is_a_missing_point(spelling):
    data = ply(f"1 2 3\n{spelling} {spelling} {spelling}\n4 5 6\n", vertices=3)
    points, _ = points_from_ply(data, PATH)
    assert np.isfinite(points).all(axis=1).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("size", "element", "body"),
    [
        ("comment width 2\ncomment height 3\n", "", ""),
        ("obj_info width 2\nobj_info height 3\n", "", ""),
        ("comment num_cols 2\ncomment num_rows 3\n", "", ""),
        (
            "",
            "element camera 1\nproperty float view_px\nproperty int viewportx\n"
            "property int viewporty\n",
            "0.5 2 3\n",
        ),
        (
            "",
            "element phoxi_frame_params 1\nproperty uint32 frame_width\n"
            "property uint32 frame_height\nproperty float frame_duration\n",
            "2 3 0.5\n",
        ),
    ],
)
def test_the_size_is_where_other_programs_write_it(size, element, body):
    text = ply("1 2 3\n" * 6 + body, vertices=6, before=size, properties=XYZ + element)
    assert points_from_ply(text, PATH)[0].shape == (3, 2, 3)


def test_comments_that_do_not_fit_leave_points_without_rows_and_say_so():
    text = ply("1 2 3\n", vertices=1, before="comment width 2\ncomment height 3\n")
    with collected_remarks() as remarks:
        assert points_from_ply(text, PATH)[0].shape == (1, 3)
    assert "1 points without rows and columns" in "".join(remarks)


@pytest.mark.parametrize("names", ["X Y Z", "px py pz", "pos_x pos_y pos_z", "x_mm y_mm z_mm"])
def test_coordinates_are_known_by_other_names(names):
    properties = "".join(f"property double {name}\n" for name in names.split())
    assert points_from_ply(ply("1 2 3\n", vertices=1, properties=properties), PATH)[0].tolist() == [
        [1, 2, 3]
    ]


def test_decimal_commas_are_read_and_said():
    with collected_remarks() as remarks:
        points, _ = points_from_ply(ply("1,5 2 -3,25\nnan nan nan\n", vertices=2), PATH)
    assert points[0].tolist() == [1.5, 2, -3.25]
    assert "decimal commas" in "".join(remarks)


def test_our_own_files_say_nothing():
    with collected_remarks() as remarks:
        points_from_ply(ply_from_points(np.ones((2, 3, 3), np.float32)), PATH)
    assert not remarks


@settings(max_examples=30, deadline=None)
@given(
    valid=hnp.arrays(bool, st.tuples(st.integers(1, 5), st.integers(1, 5))),
    kind=st.sampled_from(KINDS),
)
def test_a_range_grid_is_the_organised_cloud_without_its_missing_points(valid, kind):
    rows, columns = valid.shape
    points = np.arange(1.0, 1 + 3 * valid.size).reshape(rows, columns, 3)
    points[~valid] = np.nan
    index = np.cumsum(valid.ravel()) - 1
    header = (
        f"obj_info num_cols {columns}\nobj_info num_rows {rows}\n"
        f"element vertex {valid.sum()}\n{XYZ}"
        f"element range_grid {valid.size}\nproperty list uchar int vertex_indices\n"
    )
    body = [("fff", list(point)) for point in points[valid]]
    body += [
        ("Bi", [1, int(i)]) if there else ("B", [0])
        for i, there in zip(index, valid.ravel(), strict=True)
    ]
    np.testing.assert_array_equal(points_from_ply(encoded(kind, header, body), PATH)[0], points)


@pytest.mark.parametrize("end", ["", "\n", "\r\n", "\n\n"])
def test_faces_are_no_vertices_that_are_missing(end):
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    data = ply(f"1 2 3\n4 5 6\n3 0 1 1{end}", vertices=3, properties=XYZ + faces)
    with pytest.raises(DamagedFileError, match="cut off"):
        points_from_ply(data, PATH)


def test_text_that_ends_within_a_line_is_cut_off():
    whole = ply("1.25 2.5 3.75\n" * 6, vertices=6)
    with pytest.raises(DamagedFileError, match=r"cut off.*announces 6"):
        points_from_ply(whole[: len(whole) - 8], PATH)

import struct
import sys

import lzf
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pypcd4.pypcd4 import Encoding, PointCloud

from exposight.cell import CLOUD_SUFFIXES, Cloud, read_cloud, write_cloud
from exposight.errors import (
    CloudError,
    DamagedFileError,
    FormatError,
    InputError,
    MissingFileError,
)
from exposight.files import collected_remarks

KEEPS_SIZE = [".ply", ".pcd", ".npy"]
POINTS = np.array([[1.5, -2.25, 600.125], [np.nan] * 3, [0.1, 0.2, 0.3], [4, 5, 6]], np.float32)


@pytest.fixture
def cloud() -> Cloud:
    return Cloud(points=POINTS)


@pytest.fixture
def organised() -> Cloud:
    return Cloud(points=POINTS.reshape(2, 2, 3))


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_writing_and_reading_keeps_every_bit_and_missing_points(tmp_path, cloud, suffix):
    write_cloud(tmp_path / f"cloud{suffix}", cloud)
    np.testing.assert_array_equal(read_cloud(tmp_path / f"cloud{suffix}").points, cloud.points)


@pytest.mark.parametrize("suffix", KEEPS_SIZE)
def test_these_formats_keep_rows_and_columns(tmp_path, organised, suffix):
    write_cloud(tmp_path / f"cloud{suffix}", organised)
    np.testing.assert_array_equal(read_cloud(tmp_path / f"cloud{suffix}").points, organised.points)


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_a_given_size_makes_any_file_organised(tmp_path, cloud, organised, suffix):
    write_cloud(tmp_path / f"cloud{suffix}", cloud)
    read = read_cloud(tmp_path / f"cloud{suffix}", size=(2, 2))
    np.testing.assert_array_equal(read.points, organised.points)


@settings(max_examples=25, deadline=None)
@given(
    points=hnp.arrays(
        np.float32, st.tuples(st.integers(1, 4), st.just(3)), elements=st.floats(width=32)
    ),
    suffix=st.sampled_from(CLOUD_SUFFIXES),
)
def test_any_points_survive_any_format(tmp_path_factory, points, suffix):
    path = tmp_path_factory.mktemp("any") / f"cloud{suffix}"
    cloud = Cloud(points=points)
    write_cloud(path, cloud)
    np.testing.assert_array_equal(read_cloud(path).points, cloud.points)


def test_an_upper_case_suffix_is_the_same_format(tmp_path, cloud):
    write_cloud(tmp_path / "cloud.PLY", cloud)
    assert read_cloud(tmp_path / "cloud.PLY").n_valid == 3


@pytest.mark.parametrize("suffix", KEEPS_SIZE)
def test_an_empty_cloud_is_written_and_read(tmp_path, suffix):
    write_cloud(tmp_path / f"cloud{suffix}", Cloud(points=np.zeros((0, 3))))
    assert read_cloud(tmp_path / f"cloud{suffix}").points.shape == (0, 3)


# -- what is no cloud ---------------------------------------------------------------------------


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no point cloud at .*gone\.ply"):
        read_cloud(tmp_path / "gone.ply")


def test_an_unknown_format_lists_the_known_ones(tmp_path):
    (tmp_path / "cloud.abc").write_bytes(b"x")
    with pytest.raises(FormatError, match=r"\.ply, \.pcd, .*got the suffix '\.abc'"):
        read_cloud(tmp_path / "cloud.abc")


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_an_empty_file_is_damaged(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    path.touch()
    with pytest.raises(DamagedFileError, match=f"cloud{suffix} is empty"):
        read_cloud(path)


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_a_photograph_is_no_cloud(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(b"\xff\xd8\xff\xe0 JFIF \x00\x01\x02 a photograph")
    with pytest.raises(FormatError, match=f"cloud{suffix}"):
        read_cloud(path)


@pytest.mark.parametrize("suffix", KEEPS_SIZE)
@pytest.mark.parametrize("cut", [1, 12, 13])  # 12 bytes are a whole point
def test_a_binary_file_that_is_cut_off_is_named(tmp_path, cloud, suffix, cut):
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, cloud)
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises((DamagedFileError, FormatError), match=f"cloud{suffix}"):
        read_cloud(path)


def test_a_wrong_size_names_the_file(tmp_path, cloud):
    write_cloud(tmp_path / "cloud.csv", cloud)
    with pytest.raises(CloudError, match=r"cloud\.csv: 3 rows × 2 columns need 6 points"):
        read_cloud(tmp_path / "cloud.csv", size=(3, 2))


# -- PLY against trimesh, PCD against pypcd4 ----------------------------------------------------


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_files_of_trimesh_are_read(tmp_path, encoding):
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    path = tmp_path / "cloud.ply"
    # More decimals than float32 has, so that the text is exact.
    data = trimesh.exchange.ply.export_ply(trimesh.PointCloud(points), encoding=encoding)
    path.write_bytes(data)
    np.testing.assert_allclose(read_cloud(path).points, points, rtol=1e-6, atol=1e-7)


def test_ply_files_of_a_mesh_give_its_vertices(tmp_path):
    box = trimesh.creation.box((10, 20, 30))
    (tmp_path / "box.ply").write_bytes(trimesh.exchange.ply.export_ply(box))
    np.testing.assert_array_equal(read_cloud(tmp_path / "box.ply").points, box.vertices)


def test_ply_files_of_ours_are_read_by_trimesh(tmp_path, cloud):
    write_cloud(tmp_path / "cloud.ply", cloud)
    np.testing.assert_array_equal(trimesh.load(tmp_path / "cloud.ply").vertices, cloud.points)


def test_pcd_files_of_ours_keep_their_size_for_others(tmp_path):
    write_cloud(tmp_path / "cloud.pcd", Cloud(points=np.ones((2, 5, 3))))
    meta = PointCloud.from_path(tmp_path / "cloud.pcd").metadata
    assert (meta.height, meta.width, meta.points) == (2, 5, 10)


@pytest.mark.parametrize("encoding", list(Encoding))
def test_pcd_files_of_every_encoding_are_read(tmp_path, encoding):
    points = np.random.default_rng(0).normal(size=(6, 4)).astype(np.float32)
    cloud = PointCloud.from_xyzi_points(points)
    cloud.metadata = cloud.metadata.derive(height=2, width=3)
    cloud.save(tmp_path / "cloud.pcd", encoding=encoding)
    read = read_cloud(tmp_path / "cloud.pcd")
    np.testing.assert_allclose(read.points, points[:, :3].reshape(2, 3, 3), rtol=1e-6, atol=1e-7)


def test_a_pcd_without_coordinates_names_its_fields(tmp_path):
    cloud = PointCloud.from_points(np.ones((2, 2), np.float32), ("x", "rgb"), (np.float32,) * 2)
    cloud.save(tmp_path / "cloud.pcd")
    with pytest.raises(FormatError, match="expected the fields x, y and z, got x, rgb"):
        read_cloud(tmp_path / "cloud.pcd")


# -- PCD as other programs write it --------------------------------------------------------------


@pytest.mark.parametrize(
    "header",
    [
        "# .PCD v.7\nVERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\n"
        "HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n",
        "VERSION 0.6\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n"
        "DATA ascii\n",
        "VERSION .5\nCOLUMNS x y z\nPOINTS 2\nDATA ascii\n",
        "# of a program\n\nversion 0.7\r\nfields X Y Z # names\r\nwidth 2\r\ndata ascii\r\n",
    ],
)
def test_pcd_headers_of_all_versions_are_read(tmp_path, header):
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + b"1 2 3\n-nan(ind) nan 1.#QNAN\n")
    points = read_cloud(tmp_path / "cloud.pcd").points
    np.testing.assert_array_equal(points, [[1, 2, 3], [np.nan] * 3])


@pytest.mark.parametrize("encoding", ["binary", "binary_compressed"])
def test_pcd_fields_of_any_count_and_type_are_stepped_over(tmp_path, encoding):
    record = np.zeros(
        3, [("_", "u1", 4), ("z", "<f8"), ("d", "<f4", 5), ("x", "<f4"), ("y", "<i2")]
    )
    record["x"], record["y"], record["z"] = [1, 4, 7], [2, 5, 8], [3, 6, 9]
    body = record.tobytes()
    if encoding != "binary":
        fields = b"".join(
            np.ascontiguousarray(record[name]).tobytes() for name in record.dtype.names
        )
        packed = lzf.compress(fields + bytes(0))
        body = struct.pack("<II", len(packed), len(fields)) + packed
    header = (
        "VERSION 0.7\nFIELDS _ z d x y\nSIZE 1 8 4 4 2\nTYPE U F F F I\nCOUNT 4 1 5 1 1\nWIDTH 3\n"
        f"HEIGHT 1\nPOINTS 3\nDATA {encoding}\n"
    )
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + body)
    assert read_cloud(tmp_path / "cloud.pcd").points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_a_pcd_that_announces_more_than_it_has_allocates_nothing(tmp_path, encoding):
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1000000\nHEIGHT 1000000\n"
        f"POINTS 1000000000000\nDATA {encoding}\n"
    )
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + b"1 2 3\n" * 4)
    with pytest.raises(DamagedFileError, match=r"cloud\.pcd is cut off .* 1000000000000 points"):
        read_cloud(tmp_path / "cloud.pcd")


def test_a_pcd_of_text_that_ends_within_a_line_is_cut_off(tmp_path):
    header = "VERSION 0.7\nFIELDS x y z\nWIDTH 3\nDATA ascii\n"
    (tmp_path / "cloud.pcd").write_text(header + "1 2 3\n4 5 6\n7 8")
    with pytest.raises(DamagedFileError, match="3 points, it holds 2"):
        read_cloud(tmp_path / "cloud.pcd")


def test_a_pcd_header_that_means_nothing_is_shown(tmp_path):
    (tmp_path / "cloud.pcd").write_text("VERSION 0.7\nFIELDS x y z\nWIDTH 1\nDATA martian\n")
    with pytest.raises(FormatError, match=r"expected DATA ascii, .* got 'martian'"):
        read_cloud(tmp_path / "cloud.pcd")


# -- by content, not by name ----------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".npy"])
@pytest.mark.parametrize("name", ["cloud.txt", "cloud", "cloud.dat"])
def test_a_cloud_with_another_suffix_is_known_by_its_content(tmp_path, organised, suffix, name):
    write_cloud(tmp_path / f"cloud{suffix}", organised)
    (tmp_path / f"cloud{suffix}").rename(tmp_path / name)
    with collected_remarks() as remarks:
        np.testing.assert_array_equal(read_cloud(tmp_path / name).points, organised.points)
    assert suffix[1:].upper() in "".join(remarks)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("part.stl", b"solid part\nfacet normal 0 0 1\n", "a mesh, whose points have lost"),
        ("scan.ply", b"\0" * 80 + struct.pack("<I", 1) + bytes(50), "a mesh, whose points"),
        ("scan.las", b"LASF" + bytes(300), "export E57, PLY or PCD"),
        ("scan.zdf", b"\x89HDF\r\n", "from Zivid Studio as an organised PLY"),
        ("scan.txt", b"\x89PNG\r\n", "a depth image needs its camera"),
        ("scan.xlsx", b"PK\3\4", "save its sheet as CSV"),
        ("part.step", b"ISO-10303-21;", "a mesh, whose points"),
    ],
)
def test_what_to_export_instead_is_said(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=message):
        read_cloud(tmp_path / name)


# -- E57 -----------------------------------------------------------------------------------------


def e57(path, *scans, translation=None):
    """Write scans, (points in mm, further columns), as pye57 does."""
    pye57 = pytest.importorskip("pye57", reason="E57 files are read by the extra e57")
    with pye57.E57(str(path), mode="w") as file:
        for points, columns in scans:
            axes = {f"cartesian{a}": points[:, i] / 1000 for i, a in enumerate("XYZ")}
            file.write_scan_raw({**axes, **columns}, translation=translation)


def test_an_e57_is_in_metres_and_organised_by_its_indices(tmp_path):
    points = np.array([[1.0, 2, 500], [3, 4, 510], [5, 6, 520]])
    index = {
        "rowIndex": np.array([0, 2, 1], np.uint16),
        "columnIndex": np.array([1, 0, 1], np.uint16),
        "cartesianInvalidState": np.array([0, 0, 2], np.int8),
    }
    e57(tmp_path / "cloud.e57", (points, index), translation=np.array([1.0, 2.0, 3.0]))
    with collected_remarks() as remarks:
        cloud = read_cloud(tmp_path / "cloud.e57")
    expected = np.full((3, 2, 3), np.nan)
    expected[0, 1], expected[2, 0] = points[:2]
    np.testing.assert_allclose(cloud.points, expected, rtol=1e-6)
    assert "m converted to mm" in "".join(remarks)
    assert "its pose in the file is not applied" in "".join(remarks)
    np.testing.assert_array_equal(read_cloud(tmp_path / "cloud.e57", unit="m").points, cloud.points)


def test_an_e57_of_a_part_of_the_image_has_no_rows_and_columns(tmp_path):
    index = {"rowIndex": np.array([5, 9], np.uint16), "columnIndex": np.array([3, 4], np.uint16)}
    e57(tmp_path / "cloud.e57", (np.full((2, 3), 100.0), index))
    with collected_remarks() as remarks:
        assert read_cloud(tmp_path / "cloud.e57").points.shape == (2, 3)
    assert "its indices begin within the image" in "".join(remarks)


def test_of_several_scans_in_an_e57_one_is_chosen(tmp_path):
    one, two = np.full((4, 3), 100.0), np.full((5, 3), 200.0)
    e57(tmp_path / "cell.e57", (one, {}), (two, {}))
    with pytest.raises(InputError, match=r"holds 2 scans.*cell\.e57#1 to cell\.e57#2"):
        read_cloud(tmp_path / "cell.e57")
    assert read_cloud(tmp_path / "cell.e57#2").points.shape == (5, 3)
    with pytest.raises(FormatError, match="expected the scan 3, the file has 2"):
        read_cloud(tmp_path / "cell.e57#3")


def test_a_damaged_e57_is_named(tmp_path):
    e57(tmp_path / "cloud.e57", (np.ones((1000, 3)), {}))
    data = (tmp_path / "cloud.e57").read_bytes()
    (tmp_path / "cloud.e57").write_bytes(data[: len(data) // 2])
    with pytest.raises(FormatError, match=r"cloud\.e57 is not a readable E57 point cloud"):
        read_cloud(tmp_path / "cloud.e57")


def test_without_the_extra_an_e57_says_which_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pye57", None)
    (tmp_path / "cloud.e57").write_bytes(b"ASTM-E57" + bytes(100))
    with pytest.raises(InputError, match=r"pip install 'exposight\[e57\]'"):
        read_cloud(tmp_path / "cloud.e57")


# -- text ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3\n4 5 6\n",
        "x_mm y_mm z_mm\n1 2 3\n4 5 6\n",
        "X Y Z I\n1 2 3 99\n4 5 6 98\n",
        "//X Y Z\n1 2 3\n4 5 6\n",
        "# a comment\n  1\t2   3 0.5\n4 5 6 0.5",
        "\ufeff1 2 3\r\n4 5 6\r\n",
    ],
)
def test_xyz_files_as_programs_write_them_are_read(tmp_path, text):
    path = tmp_path / "cloud.xyz"
    path.write_text(text, encoding="utf-8", newline="")
    assert read_cloud(path).points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_another_unit_is_converted_to_mm(tmp_path):
    (tmp_path / "cloud.xyz").write_text("0.001 0.5 -1\nnan nan nan\n")
    points = read_cloud(tmp_path / "cloud.xyz", unit="m").points
    np.testing.assert_allclose(points, [[1, 500, -1000], [np.nan] * 3])
    with pytest.raises(CloudError, match="must be mm, cm, m, got 'inch'"):
        read_cloud(tmp_path / "cloud.xyz", unit="inch")


# -- NPY ----------------------------------------------------------------------------------------


def test_a_pickle_is_not_unpickled(tmp_path):
    path = tmp_path / "cloud.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(
        (FormatError, DamagedFileError), match="Python objects, which are never read"
    ):
        read_cloud(path)


def test_an_npz_is_not_taken_for_an_npy(tmp_path):
    with (tmp_path / "cloud.npy").open("wb") as file:
        np.savez(file, a=np.ones((2, 3)))
    with pytest.raises(FormatError, match=r"expected an array of numpy \(NPY\)"):
        read_cloud(tmp_path / "cloud.npy")


def test_an_npy_of_another_shape_is_named(tmp_path):
    np.save(tmp_path / "cloud.npy", np.ones((2, 4)))
    with pytest.raises(CloudError, match=r"cloud\.npy: a cloud needs points of shape"):
        read_cloud(tmp_path / "cloud.npy")


def test_a_zero_point_is_missing():
    cloud = Cloud(points=np.array([[0, 0, 0], [1, 2, 3]]))
    assert cloud.valid.tolist() == [False, True]
    assert np.isnan(cloud.points[0]).all()


def test_a_zero_coordinate_is_not_missing():
    assert Cloud(points=np.array([[0.0, 0.0, 5.0]])).n_valid == 1


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_coordinate_that_is_not_finite_makes_the_point_missing(bad):
    cloud = Cloud(points=np.array([[1.0, bad, 3.0], [1.0, 2.0, 3.0]]))
    assert np.isnan(cloud.points[0]).all()
    assert cloud.n_valid == 1


def test_an_organised_cloud_keeps_its_rows_and_columns():
    cloud = Cloud(points=np.ones((3, 4, 3)))
    assert cloud.organised
    assert cloud.valid.shape == (3, 4)
    assert cloud.points.dtype == np.float32


def test_a_cloud_neither_changes_nor_shares_the_array_it_was_given():
    points = np.zeros((5, 3), dtype=np.float32)
    cloud = Cloud(points=points)
    assert (points == 0).all()
    points[:] = 7
    assert cloud.n_valid == 0


def test_a_cloud_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        Cloud(points=np.ones((5, 3))).points[0, 0] = 2


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 2, 4), (1, 2, 2, 3)])
def test_another_shape_is_refused(shape):
    with pytest.raises(CloudError, match=r"shape \(rows, columns, 3\) or \(n, 3\) in mm, got"):
        Cloud(points=np.ones(shape))


def test_text_is_refused():
    with pytest.raises(CloudError, match="real numbers in mm, got an array of <U1"):
        Cloud(points=np.array([["a", "b", "c"]]))


def test_require_points_returns_the_valid_points_in_row_major_order():
    points = np.arange(12.0).reshape(2, 2, 3)
    points[1, 0] = 0
    expected = points.reshape(-1, 3)[[0, 1, 3]]
    np.testing.assert_array_equal(Cloud(points=points).require_points(), expected)


def test_a_cloud_with_no_valid_point_is_refused_where_points_are_needed():
    cloud = Cloud(points=np.zeros((4, 5, 3)))
    with pytest.raises(CloudError, match="no valid point: all 20 are NaN or zero"):
        cloud.require_points()


def test_organise_gives_the_image_its_rows_and_columns_back():
    points = np.arange(1.0, 19.0).reshape(2, 3, 3)
    flat = Cloud(points=points.reshape(-1, 3))
    np.testing.assert_array_equal(flat.organise(2, 3).points, points)


def test_organise_refuses_another_number_of_points():
    with pytest.raises(CloudError, match=r"2 rows × 4 columns need 8 points.*got 6"):
        Cloud(points=np.ones((6, 3))).organise(2, 4)


def test_standard_deviations_go_with_the_points(tmp_path):
    points = np.arange(18, dtype=np.float32).reshape(2, 3, 3)
    points[0, 1] = np.nan
    sigma = np.full((2, 3), 0.5)
    cloud = Cloud(points=points.reshape(6, 3), sigma_z_mm=sigma.ravel()).organise(2, 3)
    expected = np.where(cloud.valid, 0.5, np.nan)
    np.testing.assert_array_equal(cloud.sigma_z_mm, expected)
    write_cloud(tmp_path / "cloud.ply", cloud)
    back = read_cloud(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(back.sigma_z_mm, expected)
    np.testing.assert_array_equal(back.points, cloud.points)
    in_metres = read_cloud(tmp_path / "cloud.ply", unit="m")
    np.testing.assert_array_equal(in_metres.sigma_z_mm, 1000 * expected)
    write_cloud(tmp_path / "cloud.npy", cloud)
    assert read_cloud(tmp_path / "cloud.npy").sigma_z_mm is None


def test_standard_deviations_are_one_for_each_point_and_not_negative():
    points = np.ones((4, 3))
    with pytest.raises(CloudError, match=r"sigma_z_mm needs a number .* shape \(4,\), got"):
        Cloud(points=points, sigma_z_mm=np.ones(3))
    with pytest.raises(CloudError, match="0 or more, got -1 mm"):
        Cloud(points=points, sigma_z_mm=np.array([1, 2, -1, 1]))

"""Clouds as text, in the dialects that scanners' programs write."""

import numpy as np
import pytest

from exposight.cell import read_cloud
from exposight.errors import AmbiguousError, CloudError, FormatError
from exposight.files import Reading, collected_remarks, reading_as
from exposight.files.text_tables import text_samples

POINTS = np.array([[1.5, -2.25, 500.125], [3.0, 4.5, 501.0], [0.25, 6.75, 499.5]])
NAN = [np.nan] * 3


def lines(separator: str = " ", decimal: str = ".", further: tuple[str, ...] = ()) -> list[str]:
    return [
        separator.join([*(f"{x:.4f}".replace(".", decimal) for x in point), *further])
        for point in POINTS
    ]


def read(folder, text, suffix=".xyz", encoding="utf-8", **options):
    path = folder / f"cloud{suffix}"
    path.write_bytes(("\n".join(text) + "\n").encode(encoding))
    return read_cloud(path, **options).points


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv", ".asc", ".pts"])
@pytest.mark.parametrize(
    "text",
    [
        lines(),
        lines(";"),
        lines(","),
        lines(", "),
        lines("\t", ","),
        lines(";", ","),
        lines(" ", ","),
        ["3", *lines(further=("120", "90", "90", "90"))],
        ["3,,", *lines(",")],
        ["X;Y;Z", "3", *lines(";")],
        ["# made by x", *lines("\t", ",")],
        ["//X Y Z R G B", "3", *lines(further=("9", "9", "9"))],
        ["# exported 12:30", *lines()],
        ["# x y z", *lines()],
        ["X;Y;Z", *lines(";", ",")],
        ["X [mm]\tY [mm]\tZ [mm]", *lines("\t")],
        ["x,y,z,intensity", *lines(",", further=("0.5",))],
        ["Points:0,Points:1,Points:2", *lines(",")],
        [f"{k};{line}" for k, line in enumerate(lines(";", ","))],
        ["Nr;X;Y;Z", *(f"{k};{line}" for k, line in enumerate(lines(";"), 1))],
    ],
)
def test_a_cloud_is_the_same_in_each_dialect(tmp_path, suffix, text):
    np.testing.assert_allclose(read(tmp_path, text, suffix), POINTS)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "cp1252"])
def test_encodings_are_recognised(tmp_path, encoding):
    text = ["x_mm;y_mm;z_mm;Güte", *lines(";", ",", ("1",))]
    np.testing.assert_allclose(read(tmp_path, text, encoding=encoding), POINTS)


@pytest.mark.parametrize("word", ["nan", "-nan(ind)", "1.#QNAN", "-1.#IND00", "NaN", "0"])
def test_missing_points_keep_their_place(tmp_path, word):
    text = lines()
    text.insert(1, " ".join([word] * 3))
    np.testing.assert_allclose(read(tmp_path, text), [POINTS[0], NAN, *POINTS[1:]])


@pytest.mark.parametrize(
    ("header", "factor"), [("x_m,y_m,z_m", 1000), ("X (in),Y (in),Z (in)", 25.4), ("x,y,z", 1)]
)
def test_units_in_the_header_are_converted(tmp_path, header, factor):
    np.testing.assert_allclose(read(tmp_path, [header, *lines(",")]), POINTS * factor, rtol=1e-6)


def test_columns_are_found_in_any_order(tmp_path):
    text = ["r,g,b,z,y,x", *(f"9,9,9,{z},{y},{x}" for x, y, z in POINTS)]
    np.testing.assert_allclose(read(tmp_path, text), POINTS)


@pytest.mark.parametrize("header", ["row;col;x_mm;y_mm;z_mm", "v;u;x;y;z", "Zeile;Spalte;X;Y;Z"])
@pytest.mark.parametrize("base", [0, 1])
def test_rows_and_columns_make_the_cloud_organised(tmp_path, header, base):
    pixels = [(0, 0), (0, 1), (1, 0)]
    text = [
        f"{r + base};{c + base};{x};{y};{z}"
        for (r, c), (x, y, z) in zip(pixels, POINTS, strict=True)
    ]
    expected = [[POINTS[0], POINTS[1]], [POINTS[2], NAN]]
    np.testing.assert_allclose(read(tmp_path, [header, *text], ".csv"), expected)


@pytest.mark.parametrize("turned", [False, True])
def test_i_and_j_are_told_by_x_and_y(tmp_path, turned):
    rows, columns = np.mgrid[0:4, 0:5]
    points = np.dstack([columns * 2.0 - 4, rows * 3.0 - 5, np.full((4, 5), 500.0)])
    text = [
        " ".join(map(str, (c, r, *points[r, c]) if turned else (r, c, *points[r, c])))
        for r, c in np.ndindex(4, 5)
    ]
    np.testing.assert_allclose(read(tmp_path, ["i j x y z", *text]), points)


def test_normals_are_no_pixels(tmp_path):
    text = ["x,y,z,i,j,k", *lines(",", further=("0", "0", "1"))]
    np.testing.assert_allclose(read(tmp_path, text), POINTS)


def test_a_missing_point_at_the_corner_tells_the_size(tmp_path):
    text = ["row;col;x;y;z", "0;0;1;2;3", "1;2;4;5;6", "1;2;0;0;0"]
    assert read(tmp_path, text).shape == (2, 3, 3)


def test_a_size_is_that_of_the_image(tmp_path):
    text = ["row col x y z", "0 1 1 2 3"]
    assert read(tmp_path, text, size=(3, 4)).shape == (3, 4, 3)
    with pytest.raises(CloudError, match="outside 1 × 1 pixels"):
        read(tmp_path, text, size=(1, 1))


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (["1 2 3", "4 5"], FormatError, "line 2 has 2"),
        (["1 2 3", "4 5 soft", "x 1 2"], FormatError, "line 2, column 3: 'soft', line 3"),
        (["1 2", "3 4"], FormatError, "expected 3 columns or more"),
        (["4", "1 2 3 4", "5 6 7 8"], FormatError, "announces 4 rows, it holds 2"),
        (["x,y,intensity", "1,2,3"], FormatError, "missing column z_mm"),
        (["x_mm,y_mm,z_mm,X", "1,2,3,4"], FormatError, "are both x_mm"),
        (["row;col;x;y;z", "0;0;1;2;3", "0;0;1;2;4"], CloudError, "row 0, column 0"),
        (["row;col;x;y;z", "0.5;0;1;2;3"], FormatError, "whole numbers from 0"),
        (["i;j;x;y;z", "0;0;1;2;3"], FormatError, "may be row and column"),
        (["0 0 1 2 3", "0 1 2 2 3", "1 0 4 5 6"], FormatError, "seem to be rows and columns"),
    ],
)
def test_what_is_no_cloud_is_refused(tmp_path, text, error, message):
    with pytest.raises(error, match=message):
        read(tmp_path, text, ".csv")


@pytest.mark.parametrize("separator", [",", ", "])
def test_decimal_commas_between_commas_are_asked(tmp_path, separator):
    text = lines(separator, ",")
    with pytest.raises(AmbiguousError):
        read(tmp_path, text)
    with reading_as(Reading(decimal="comma")):
        np.testing.assert_allclose(read(tmp_path, text), POINTS)


def test_a_unit_that_the_header_contradicts_is_refused(tmp_path):
    text = ["x_mm,y_mm,z_mm", *lines(",")]
    with pytest.raises(CloudError, match="are in mm, so the unit cannot be m"):
        read(tmp_path, text, unit="m")
    with reading_as(Reading(unit="inch")):
        np.testing.assert_allclose(read(tmp_path, lines()), POINTS * 25.4, rtol=1e-6)


def test_what_was_recognised_is_said(tmp_path):
    with collected_remarks() as remarks:
        read(tmp_path, lines(";", ",", ("9", "9", "9")))
    assert "semicolons" in "".join(remarks)
    assert "the first three of 6 columns" in "".join(remarks)
    with collected_remarks() as remarks:
        read(tmp_path, lines())
    assert not remarks


@pytest.mark.parametrize("separator", [" ", "\t", ";", ", ", "  "])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("head", [[], ["2000"], ["# a scan"], ["X Y Z"]])
def test_large_files_are_read_as_small_ones(tmp_path, monkeypatch, separator, decimal, head):
    if separator == ", " and decimal == ",":
        separator = ";"
    monkeypatch.setattr(text_samples, "_SMALL", 0)
    points = np.random.default_rng(4).uniform(-999, 999, (2000, 3)).round(3)
    points[7] = np.nan
    text = [separator.join(f"{x:.3f}".replace(".", decimal) for x in point) for point in points]
    head = [line.replace(" ", separator) if line == "X Y Z" else line for line in head]
    np.testing.assert_allclose(read(tmp_path, [*head, *text]), points, rtol=1e-6)


@pytest.mark.parametrize("line", ["1 2", "1 2 3 4", "1 2 x", "1 2,5 3"])
def test_a_wrong_line_of_a_large_file_is_named(tmp_path, monkeypatch, line):
    monkeypatch.setattr(text_samples, "_SMALL", 0)
    text = ["1.5 2.5 3.5"] * 3000
    text[1700] = line
    with pytest.raises(FormatError, match="line 1701"):
        read(tmp_path, text)


GRID = np.array([[x, y + 0.5, 480.25 + 0.125 * x] for x in range(-5, 5) for y in range(-4, 4)])


@pytest.mark.parametrize(
    "before",
    [
        np.arange(80)[:, None] % 7,
        np.arange(80)[:, None] % 7 / 8,
        np.tile([90, 120, 7], (80, 1)) + np.arange(80)[:, None],
        np.tile([0.0, 0.6, -0.8], (80, 1)),
    ],
)
def test_grey_levels_and_normals_before_x_y_z_are_asked_about(tmp_path, before):
    rows = [" ".join(f"{x:g}" for x in row) for row in np.hstack([before, GRID])]
    with pytest.raises(FormatError, match="name the columns"):
        read(tmp_path, rows)
    turned = [" ".join(f"{x:g}" for x in row) for row in np.hstack([GRID, before])]
    np.testing.assert_allclose(read(tmp_path, turned), GRID, atol=1e-3)


@pytest.mark.parametrize("mark", ["-999", "9999", "1e10", "-9999.0"])
def test_points_at_one_place_are_missing(tmp_path, mark):
    rows = [" ".join(f"{x:g}" for x in point) for point in GRID]
    rows[::9] = [" ".join([mark] * 3)] * len(rows[::9])
    with collected_remarks() as remarks:
        points = read(tmp_path, rows)
    assert np.isnan(points[::9]).all()
    assert np.isfinite(np.delete(points, np.s_[::9], axis=0)).all()
    assert "9 points at" in "".join(remarks)


def test_a_unit_in_a_comment_is_the_unit(tmp_path):
    rows = [" ".join(f"{x / 1000:.7g}" for x in point) for point in GRID]
    for head in ("# unit: m", "// Units = [m]"):
        points = read(tmp_path, ["# GOM", head, *rows])
        np.testing.assert_allclose(points, GRID, atol=1e-3)
    with pytest.raises(CloudError, match="cannot be cm"):
        read(tmp_path, ["# unit: m", *rows], unit="cm")

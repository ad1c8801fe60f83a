"""Observation tables as other programs write them."""

import numpy as np
import pytest

from exposight.errors import AmbiguousError, FormatError
from exposight.files import Reading, collected_remarks, reading_as
from exposight.observing import read_inputs, read_observations

NAMES = [
    "feature",
    "view",
    "exposure_ms",
    "p_norm",
    "i_avg",
    "x_mm",
    "y_mm",
    "z_mm",
    "w_deg",
    "p_deg",
    "r_deg",
    "radius_mm",
]
PLAIN = ["feature", "view", "t_exp", "quality", "intensity", *"xyzwpr", "radius"]
ROWS = [
    ["h1", "v1", 5.5, 0.25, 20.5, -50.25, 40.0, 8.5, 12.5, -3.25, 0.0, 6.0],
    ["h2", "v1", 12.0, 0.75, 90.0, 55.5, -42.0, -7.25, -11.0, 4.5, 0.0, 6.0],
    ["h1", "v2", 30.5, 1.0, 200.25, 20.125, 14.0, 3.5, 8.0, 9.75, 90.0, 6.0],
]
NUMBERS = np.array([row[2:] for row in ROWS])


def text(*, separator=",", decimal=".", names=None, rows=ROWS, index=None, scale=None):
    names = list(NAMES) if names is None else names
    lines = [[*([index] if index is not None else []), *names]]
    for k, row in enumerate(rows):
        cells = [
            cell if isinstance(cell, str) else repr(cell * (scale or {}).get(name, 1.0))
            for name, cell in zip(NAMES, row, strict=True)
        ]
        cells = [cell.replace(".", decimal) for cell in cells]
        lines.append([*([str(k)] if index is not None else []), *cells])
    return "\n".join(map(separator.join, lines)) + "\n"


def renamed(**names):
    return [names.get(name, name) for name in NAMES]


def read(folder, content, encoding="utf-8", name="table.csv"):
    path = folder / name
    path.write_bytes(content.encode(encoding))
    with collected_remarks() as remarks:
        table = read_observations(path)
    return table, " ".join(remarks)


@pytest.mark.parametrize(
    ("content", "encoding", "said"),
    [
        (text(), "utf-8", ""),
        (text(), "utf-8-sig", ""),
        (text().replace("\n", "\r\n"), "utf-8", ""),
        (text(separator=";", decimal=","), "utf-8-sig", "semicolons between the cells, decimal"),
        (text(separator="\t"), "utf-16", "characters in UTF-16, tabs"),
        (text(separator="|"), "utf-8", "pipes"),
        (text(index=""), "utf-8", "counts the rows"),
        (text(index="Unnamed: 0"), "utf-8", "counts the rows"),
        (text(index="index", separator=";", decimal=","), "cp1252", "counts the rows"),
        ("sep=;\n" + text(separator=";", decimal=","), "cp1252", "semicolons"),
        ("# made on Monday\n" + text(), "utf-8", ""),
        (text(names=[name.upper() for name in NAMES]), "utf-8", ""),
        (
            text(
                names=renamed(exposure_ms="exposure_us"),
                scale={"exposure_ms": 1000.0},
            ),
            "utf-8",
            "exposure_us converted to exposure_ms",
        ),
        (
            text(names=renamed(exposure_ms="t_exp [µs]"), scale={"exposure_ms": 1000.0}),
            "utf-8",
            "t_exp [µs] converted to exposure_ms",
        ),
        (
            text(names=renamed(p_norm="p_norm [%]"), scale={"p_norm": 100.0}),
            "utf-8",
            "p_norm [%] converted",
        ),
        (
            text(names=PLAIN),
            "utf-8",
            "t_exp, x, y, z, w, p, r, radius without a unit taken as exposure_ms, x_mm",
        ),
        (
            text(separator=";", names=[n.replace("_mm", " [mm]").replace("_deg", " [°]")
                                       for n in NAMES]),
            "cp1252",
            "w [°], p [°], r [°] read as w_deg",
        ),
    ],
)  # fmt: skip
def test_a_table_is_the_same_in_each_dialect(tmp_path, content, encoding, said):
    table, remarks = read(tmp_path, content, encoding)
    np.testing.assert_allclose(table.array(NAMES[2:]), NUMBERS)
    assert table.names("feature").tolist() == ["h1", "h2", "h1"]
    assert said in remarks
    assert bool(said) == bool(remarks)


@pytest.mark.parametrize("word", ["nan", "NA", "#NV", "NULL", "-", ""])
def test_words_for_missing_values_are_empty(tmp_path, word):
    rows = [[*ROWS[0][:3], word, word, *ROWS[0][5:]], *ROWS[1:]]
    for decimal, separator in ((".", ","), (",", ";")):
        table, _ = read(tmp_path, text(rows=rows, decimal=decimal, separator=separator))
        assert table.frame["p_norm"].to_list() == [None, 0.75, 1.0]
        assert table.frame["i_avg"].to_list() == [None, 90.0, 200.25]


def test_further_columns_keep_their_kind(tmp_path):
    lines = text(separator=";").splitlines()
    more = [";shift;operator;good;ratio", ";1;Ann;true;0.5", ";2;Bo;false;0.25", ";3;;true;1"]
    table, _ = read(tmp_path, "\n".join(map(str.__add__, lines, more)))
    assert table.frame["shift"].to_list() == [1, 2, 3]
    assert table.frame["operator"].to_list() == ["Ann", "Bo", None]
    assert table.frame["good"].to_list() == [True, False, True]
    assert table.frame["ratio"].to_list() == [0.5, 0.25, 1.0]


def test_names_that_are_numbers_stay_texts(tmp_path):
    table, _ = read(tmp_path, text(separator=";").replace("h1", "007"))
    assert table.names("feature").tolist() == ["007", "h2", "007"]


@pytest.mark.parametrize(
    ("content", "question"),
    [
        (text(names=renamed(exposure_ms="exposure"), scale={"exposure_ms": 0.05}), "exposure"),
        (text(names=renamed(exposure_ms="exposure"), scale={"exposure_ms": 0.001}), "exposure"),
        (
            text(
                names=renamed(x_mm="x", y_mm="y", z_mm="z"),
                scale=dict.fromkeys(("x_mm", "y_mm", "z_mm"), 0.001),
            ),
            "unit",
        ),
        (
            text(
                names=renamed(w_deg="w", p_deg="p", r_deg="r"),
                scale=dict.fromkeys(("w_deg", "p_deg", "r_deg"), np.pi / 180),
            ),
            "angle",
        ),
        (text(names=renamed(x_mm="x", y_mm="y [m]")), "unit"),
    ],
)
def test_a_unit_that_values_do_not_tell_is_asked(tmp_path, content, question):
    with pytest.raises(AmbiguousError) as caught:
        read(tmp_path, content)
    assert all(answer.startswith(question) for answer in caught.value.readings)


def test_an_answer_is_taken(tmp_path):
    content = text(names=renamed(exposure_ms="exposure"), scale={"exposure_ms": 0.001})
    with reading_as(Reading(exposure="s")):
        table, _ = read(tmp_path, content)
    np.testing.assert_allclose(table.array(["exposure_ms"])[:, 0], NUMBERS[:, 0])
    with reading_as(Reading(separator="semicolon")), pytest.raises(FormatError):
        read(tmp_path, text())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (text(names=renamed(x_mm="xx", exposure_ms="exposre_ms")), r"column x_mm.*'exposure_ms'"),
        (text(names=renamed(p_norm="x")), "missing column p_norm.*'x' and 'x_mm' are both x_mm"),
        (text().replace("5.5,", "", 1), "line 2 has 11"),
        (text(separator=";") + "h3;v1;1\nh4\n", "line 5 has 3, line 6 has 1"),
        (text(rows=[[*ROWS[0][:5], "left", "up", *ROWS[0][7:]]]), "x_mm: 'left', .*y_mm: 'up'"),
        (text(names=renamed(r_deg="a_deg", w_deg="w", p_deg="p")), "missing column r_deg"),
    ],
)
def test_all_faults_are_named_at_once(tmp_path, content, message):
    with pytest.raises(FormatError, match=message):
        read(tmp_path, content)


def test_inputs_are_read_in_any_dialect(tmp_path):
    path = tmp_path / "planned.csv"
    path.write_text("X [cm];i_avg\n1,5;90\n-2;30\n")
    frame = read_inputs(path, ("x_mm", "i_avg"))
    assert frame["x_mm"].to_list() == [15.0, -20.0]


@pytest.mark.parametrize("mark", ["-999", "9999", "-99999"])
@pytest.mark.parametrize("separator", [",", ";"])
def test_numbers_that_stand_for_missing_values_are_no_values(tmp_path, mark, separator):
    rows = [list(row) for row in ROWS]
    rows[1][5], rows[2][8] = float(mark), float(mark)
    with pytest.raises(FormatError, match=rf"line 3, x_mm: {mark}, line 4, w_deg: {mark}"):
        read(tmp_path, text(rows=rows, separator=separator))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_titles_with_the_separators_of_spreadsheets_are_left_out(tmp_path, separator):
    decimal = "." if separator == "," else ","
    rest = separator * (len(NAMES) - 1)
    title = f"Messung vom 12.3.2024{rest}\nPrüfer{separator}Meier{rest[1:]}\n{rest}\n"
    table, remarks = read(tmp_path, title + text(separator=separator, decimal=decimal))
    np.testing.assert_allclose(table.array(NAMES[2:]), NUMBERS)
    assert "2 lines above the names left out" in remarks

"""One reader of text tables: what it recognises, what it asks, what it refuses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import AmbiguousError, FormatError
from exposight.files import Reading, TextTable, Wanted, match_columns, parse_table

MARKS = {"comma": ",", "semicolon": ";", "tab": "\t", "pipe": "|", "blank": " "}


def read(text: str | bytes, *, header: bool | None = None, **answers: str) -> TextTable:
    data = text if isinstance(text, bytes) else text.encode()
    return parse_table(data, "table.csv", header=header, reading=Reading(**answers))


def numbers(table: TextTable) -> list[list[float]]:
    return table.numbers(*range(table.columns)).tolist()


@pytest.mark.parametrize(
    "text",
    [
        "x,y\n1.5,2\n-3,4e2\n",
        "x;y\n1,5;2\n-3;4e2\n",
        "x\ty\r\n1,5\t2\r\n-3\t4e2\r\n",
        "x y\r1.5 2\r-3 4e2\r",
        "  x     y\n1,5   2\n -3 4e2\n",
        "x|y\n1.5|2\n-3|4e2\n",
        "sep=;\nx;y\n1,5;2\n-3;4e2\n",
        '"x","y"\n"1,5","2"\n"-3","4e2"\n',
        "x,y,\n1.5,2,\n-3,4e2,\n",
        ",x,y\n0,1.5,2\n1,-3,4e2\n",
        "Unnamed: 0,x,y\n7,1.5,2\n3,-3,4e2\n",
        '"x" "y"\n"1" 1.5 2\n"2" -3 4e2\n',
        "# written on Monday\n# x y\n1.5 2\n-3 4e2\n",
        "//x y\n2\n1.5 2\n-3 4e2\n",
        "2\nx y\n1.5 2\n-3 4e2\n".replace("2\nx y\n", "x y\n2\n"),
        "x;y\n\n1,5;2\n;\n-3;4e2\n\n",
        "x,y\n1.5,2\n# -1,-1\n-3,4D2\n",
    ],
)
def test_a_table_is_the_same_in_each_dialect(text: str) -> None:
    table = read(text)
    assert table.header == ("x", "y")
    assert numbers(table) == [[1.5, 2.0], [-3.0, 400.0]]


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252"]
)
def test_encodings_are_recognised(encoding: str) -> None:
    table = read("name;Ø [mm]\nh1;1,5\n".encode(encoding), header=True)
    assert table.header == ("name", "Ø [mm]")
    assert table.numbers("Ø [mm]").tolist() == [1.5]


@pytest.mark.parametrize(
    ("written", "number"),
    [("1.234,5", 1234.5), ("1'234,5", 1234.5), ("1\u00a0234,5", 1234.5), ("−1,5", -1.5)],
)
def test_marks_between_thousands_are_recognised(written: str, number: float) -> None:
    assert read(f"x;y\n{written};2,5\n").numbers("x").tolist() == [number]


@pytest.mark.parametrize(
    "word",
    [
        "",
        "nan",
        "NaN",
        "NA",
        "N/A",
        "n/a",
        "#N/A",
        "#NV",
        "#DIV/0!",
        "NULL",
        "null",
        "None",
        "-",
        "--",
        "—",
        "1.#QNAN",
        "-1.#IND",
        "-nan(ind)",
        "-nan",
        "1.#IND00",
        "+nan",
        "nan(snan)",
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_words_for_missing_values_are_empty(word: str, separator: str) -> None:
    table = read(f"x{separator}y\n{word}{separator}1.5\n2.5{separator}{word}\n")
    assert np.isnan(table.numbers("x")).tolist() == [True, False]
    assert table.rows[0][0] == table.rows[1][1] == ""


@pytest.mark.parametrize(
    ("text", "answers"),
    [
        ("12,5,13,2\n14,1,2,3\n", {"comma": [[12.5, 13.2], [14.1, 2.3]]}),
        ("x;y\n1,234;2\n", {"comma": [[1.234, 2.0]], "point": [[1234.0, 2.0]]}),
        ("x;y\n1.234;2\n", {"comma": [[1234.0, 2.0]], "point": [[1.234, 2.0]]}),
        ("1,234 2,345\n", {"comma": [[1.234, 2.345]], "point": [[1234.0, 2345.0]]}),
    ],
)
def test_what_two_readings_fit_is_asked(text: str, answers: dict[str, list[list[float]]]) -> None:
    with pytest.raises(AmbiguousError) as caught:
        read(text)
    assert caught.value.readings == ("decimal=comma", "decimal=point") or caught.value.readings == (
        "decimal=point",
        "decimal=comma",
    )
    for answer, expected in answers.items():
        assert numbers(read(text, decimal=answer)) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y\n12,5,13,2\n", [[12.5, 13.2]]),  # two names: decimal commas
        ("a,b,c,d\n12,5,13,2\n", [[12.0, 5.0, 13.0, 2.0]]),
        ("x;y\n1,234;0,5\n", [[1.234, 0.5]]),
        ("x;y\n1.234;1000\n", [[1.234, 1000.0]]),  # thousands without a mark
        ("x y\n1.234 2.345\n", [[1.234, 2.345]]),
        ("1, 2, 3\n", [[1.0, 2.0, 3.0]]),
    ],
)
def test_what_one_reading_fits_is_not_asked(text: str, expected: list[list[float]]) -> None:
    assert numbers(read(text)) == expected


def test_ragged_rows_are_refused_all_at_once() -> None:
    with pytest.raises(FormatError, match="line 3 has 1, line 5 has 3"):
        read("x,y\n1,2\n3\n4,5\n6,7,8\n")


def test_cells_that_are_no_numbers_are_refused_all_at_once() -> None:
    table = read("x;y\n1,5;2\n1,5;soft\n" + "2;hard\n" * 20)
    with pytest.raises(FormatError, match=r"line 3, y: 'soft', line 4, y: 'hard'.* and 11 more"):
        table.numbers("x", "y")


@pytest.mark.parametrize(
    ("text", "answers"),
    [
        ("x,y\n1.5,2.5\n", {"separator": "semicolon"}),
        ("x;y\n1.5;2.5\n", {"decimal": "comma"}),
        ("x;Ø\n1;2\n".encode("cp1252"), {"encoding": "utf-8"}),
    ],
)
def test_an_answer_that_does_not_fit_is_an_error(
    text: str | bytes, answers: dict[str, str]
) -> None:
    with pytest.raises(FormatError):
        numbers(read(text, **answers))


def test_decimal_marks_that_are_mixed_are_refused() -> None:
    with pytest.raises(FormatError, match=r"points.*commas"):
        read("x;y\n1,5;2.5\n")


def test_lines_of_a_title_are_left_out() -> None:
    text = "Report;12\nOperator;Bo;;\n\nName;X;Y;Z\nh1;1,5;2;3\nh2;4;5;6,5\n"
    table = read(text, header=True)
    assert table.header == ("Name", "X", "Y", "Z")
    assert "2 lines above the names left out" in table.remarks
    assert table.lines == (5, 6)


def test_cells_of_several_lines_are_one() -> None:
    table = read('"X\n[mm]";"Y\r\n[mm]"\n1,5;2\n', header=True)
    assert table.header == ("X [mm]", "Y [mm]")


def test_names_that_begin_as_comments_do_are_rows() -> None:
    assert read("name;x\n#1;2,5\n#2;3,5\n", header=True).texts("name") == ["#1", "#2"]


def test_a_row_of_ones_is_no_line_of_units() -> None:
    assert numbers(read("x,y\n1,1\n2,2\n", header=True)) == [[1, 1], [2, 2]]
    table = read("x;y\nmm;-\n1,5;2\n", header=True)
    assert table.header == ("x [mm]", "y")


def test_names_separated_otherwise_than_rows_are_refused() -> None:
    with pytest.raises(FormatError):
        read("x,y\n1 2\n3 4\n")


def test_a_count_that_is_not_that_of_the_rows_is_refused() -> None:
    with pytest.raises(FormatError, match="announces 3 rows, it holds 2"):
        read("3\n1 2 3\n4 5 6\n")


def test_our_own_form_says_nothing() -> None:
    assert read("x_mm,y_mm\n1.5,2\n", header=True).remarks == ()


WANTED = (
    Wanted(name="x_mm", aliases=("x", "pos x"), quantity="length"),
    Wanted(name="y_mm", aliases=("y",), quantity="length"),
    Wanted(name="exposure_ms", aliases=("t_exp",), quantity="time", required=False),
)


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        (("x_mm", "y_mm"), [1.0, 1.0]),
        (("X [mm]", "Y (in)"), [1.0, 25.4]),
        (("Pos. X / m", "y in cm"), [1000.0, 10.0]),
        (("x µm", "y_um", "T_exp [µs]"), [0.001, 0.001, 0.001]),
        (("x", "y", "exposure_s"), [1.0, 1.0, 1000.0]),
    ],
)
def test_columns_are_found_by_name_and_unit(header: tuple[str, ...], factors: list[float]) -> None:
    matched = match_columns(header, WANTED, "table.csv")
    assert [each.factor for each in matched.values()] == factors


def test_all_faults_of_columns_are_named_at_once() -> None:
    with pytest.raises(FormatError, match=r"missing column y_mm.*'exposure_ms'.*'x' and 'X_mm'"):
        match_columns(("x", "X_mm", "exposre_ms"), WANTED, "table.csv")


@pytest.mark.parametrize("header", ["x [kg]", "x_s", "X / °"])
def test_a_unit_of_another_quantity_is_named(header: str) -> None:
    with pytest.raises(FormatError, match=r"has the unit .*, expected x_mm or another of mm, cm"):
        match_columns((header, "y"), WANTED, "table.csv")


def test_a_unit_that_others_have_is_asked() -> None:
    with pytest.raises(AmbiguousError):
        match_columns(("x [m]", "y"), WANTED, "table.csv")
    matched = match_columns(("x [m]", "y"), WANTED, "table.csv", Reading(unit="m"))
    assert matched["y_mm"].factor == 1000.0


FLOATS = st.one_of(
    st.floats(allow_infinity=False),
    st.integers(-3000, 3000).map(float),
    st.decimals(-5000, 5000, places=3).map(float),
)


@st.composite
def dialects(draw: st.DrawFn) -> dict[str, object]:
    separator = draw(st.sampled_from(sorted(MARKS)))
    decimal = draw(st.sampled_from(["point", "comma"]))
    return {
        "separator": separator,
        "decimal": decimal,
        "encoding": draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "cp1252"])),
        "newline": draw(st.sampled_from(["\n", "\r\n", "\r"])),
        "index": draw(st.booleans()),
        "header": draw(st.booleans()),
        "whole": draw(st.booleans()),
        "missing": draw(st.sampled_from(["nan", "NA", "", "-nan(ind)", "#NV", "-", "1.#QNAN"])),
        "quoted": draw(st.booleans()) or (separator == "comma" and decimal == "comma"),
    }


def written(rows: list[list[float]], dialect: dict[str, object]) -> bytes:
    def spelled(number: float) -> str:
        if np.isnan(number):
            word = str(dialect["missing"])
            return word or ("nan" if dialect["separator"] == "blank" else "")
        whole = dialect["whole"] and number.is_integer() and abs(number) < 1e15
        text = str(int(number)) if whole else repr(number)
        text = text.replace(".", "," if dialect["decimal"] == "comma" else ".")
        return f'"{text}"' if dialect["quoted"] else text

    mark = MARKS[str(dialect["separator"])]
    lines = [[*map(spelled, row)] for row in rows]
    if dialect["header"]:
        lines = [[f"column_{'abc'[k]}" for k in range(len(rows[0]))], *lines]
        if dialect["index"]:
            lines = [["index", *lines[0]], *([str(k), *row] for k, row in enumerate(lines[1:]))]
    text = str(dialect["newline"]).join(map(mark.join, lines))
    return (text + str(dialect["newline"])).encode(str(dialect["encoding"]))


TABLES = st.integers(2, 3).flatmap(
    lambda width: st.lists(st.lists(FLOATS, min_size=width, max_size=width), min_size=1, max_size=5)
)


@settings(deadline=None, max_examples=300)
@given(TABLES, dialects())
def test_a_table_reads_back_or_is_asked_about(
    rows: list[list[float]], dialect: dict[str, object]
) -> None:
    data = written(rows, dialect)
    header = bool(dialect["header"])
    try:
        table = parse_table(data, "table.csv", header=None)
    except AmbiguousError:
        pass
    else:
        np.testing.assert_array_equal(numbers(table), rows)
        assert bool(table.header) == header
    reading = Reading(separator=str(dialect["separator"]), decimal=str(dialect["decimal"]))
    table = parse_table(data, "table.csv", header=header, reading=reading)
    np.testing.assert_array_equal(numbers(table), rows)


def test_a_name_of_very_many_brackets_has_no_unit_and_takes_no_time():
    wanted = [Wanted(name="y")]
    assert match_columns(("x" + "(" * 100_000, "y"), wanted, "table.csv").keys() == {"y"}

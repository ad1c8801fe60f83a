"""The observation table: what comes back from disk, and what is refused."""

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import (
    FileError,
    FormatError,
    InputError,
    MissingFileError,
    ObservationError,
)
from exposight.observing import (
    SCHEMA,
    Observation,
    ObservationTable,
    Visibility,
    parse_observations,
    read_inputs,
    read_observations,
)
from exposight.observing.schema import RANGES

QUANTILES = [
    f"{stem}_p{percent}"
    for stem in ("i_mean", "i_max", "i_mod")
    for percent in (["05", "25", "50", "75", "95"])
]
MEASURED = Observation(
    feature="f1",
    view="v1",
    exposure_ms=10.0,
    p_norm=0.9,
    i_avg=120.5,
    x_mm=1.0,
    y_mm=-2.0,
    z_mm=30.0,
    w_deg=1.5,
    p_deg=-3.0,
    r_deg=0.0,
    radius_mm=5.0,
    n_points=90,
    n_pixels=100,
    i_std=3.0,
    i_median=120.0,
    i_p05=110.0,
    i_p95=130.0,
    clipped_share=0.01,
    incidence_deg=4.0,
    visibility="visible",
    emulated=False,
    i_mean=119.0,
    **dict.fromkeys(QUANTILES, 100.5),
    stack_clipped_share=0.02,
    low_modulation_share=0.0,
    brightness_source="stripes-mean",
    sensor="scanner",
    part="door",
    finish="primer",
    tcp="0 0 600 0 0 0",
    part_w_deg=10.0,
    part_p_deg=0.0,
    part_r_deg=-170.0,
)
UNMEASURED = replace(
    MEASURED,
    feature="f2",
    visibility="facing away",
    **dict.fromkeys(
        ["p_norm", "i_avg", "n_points", "n_pixels", "i_std", "i_median", "i_p05", "i_p95"]
    ),
    clipped_share=None,
    **dict.fromkeys(["i_mean", *QUANTILES, "stack_clipped_share", "low_modulation_share"]),
    finish=None,
)
OPTIONAL = tuple(SCHEMA)[12:]

suffixes = pytest.mark.parametrize("suffix", [".csv", ".parquet"])


def table_of(*rows):
    return ObservationTable.from_observations(rows)


def rows_of(table):
    return [Observation(**row) for row in table.frame.select(list(SCHEMA)).iter_rows(named=True)]


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a frame of two rows, with columns replaced, as CSV."""

    def write(**columns):
        frame = table_of(MEASURED, UNMEASURED).frame
        changed = {name: pl.Series(values) for name, values in columns.items()}
        path = tmp_path / "observations.csv"
        frame.with_columns(**changed).write_csv(path)
        return path

    return write


# -- round trips --------------------------------------------------------------------------------

characters = st.characters(exclude_categories=["C"]) | st.sampled_from("=+-@'")
names = st.text(characters, min_size=1, max_size=255).filter(str.strip)
# Not -999, 9999, …, which stand for missing values.
places = st.floats(-1e6, 1e6).filter(lambda place: set(f"{abs(place):.6f}".strip("0.")) != {"9"})
angles = st.floats(-360, 360)
grey_levels = st.floats(0, 255)
measured_rows = st.builds(
    Observation,
    feature=names,
    view=names,
    exposure_ms=st.floats(1e-9, 3.6e6),
    p_norm=st.floats(0, 1.1),  # more would contradict the pixels
    i_avg=grey_levels,
    x_mm=places,
    y_mm=places,
    z_mm=places,
    w_deg=angles,
    p_deg=angles,
    r_deg=angles,
    radius_mm=places.map(abs),
    n_points=st.integers(0, 2**53),
    n_pixels=st.integers(1, 2**53),
    i_std=grey_levels,
    i_median=grey_levels,
    i_p05=grey_levels,
    i_p95=grey_levels,
    clipped_share=st.floats(0, 1),
    incidence_deg=st.floats(0, 180),
    visibility=st.just("visible"),
    emulated=st.booleans(),
    **dict.fromkeys(["i_mean", *QUANTILES], st.none() | grey_levels),
    stack_clipped_share=st.none() | st.floats(0, 1),
    low_modulation_share=st.none() | st.floats(0, 1),
    brightness_source=st.none() | st.sampled_from(["stripe", "stripes-mean", "texture", "dots"]),
    **dict.fromkeys(["sensor", "part", "finish", "tcp"], st.none() | names),
    **dict.fromkeys(["part_w_deg", "part_p_deg", "part_r_deg"], st.none() | angles),
)
rows = st.lists(
    measured_rows | st.just(UNMEASURED),
    min_size=1,
    max_size=5,
    unique_by=lambda row: (row.feature, row.view, row.exposure_ms),
)


@suffixes
@given(rows=rows)
@settings(max_examples=60, deadline=None)
def test_every_value_comes_back_exactly(tmp_path_factory, suffix, rows):
    path = tmp_path_factory.mktemp("table") / f"observations{suffix}"
    table_of(*rows).write(path)
    assert rows_of(read_observations(path)) == rows


@pytest.mark.parametrize("name", ["=1+1", "@SUM(A1)", "+cmd", "-x", "'=y", "''-z"])
def test_no_name_is_a_formula_in_a_spreadsheet(tmp_path, name):
    path = tmp_path / "table.csv"
    table_of(replace(MEASURED, feature=name, extra={f"{name} mm": "=2"})).write(path)
    header, row = path.read_text().splitlines()
    assert header.endswith(f",'{name} mm")
    assert row.startswith(f"'{name},")
    assert row.endswith(",'=2")
    back = read_observations(path).frame
    assert (back["feature"][0], back[f"{name} mm"][0]) == (name, "=2")


def test_the_documented_ranges_are_those_that_are_checked():
    text = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    section = text.partition("\n## Observation table\n")[2].partition("\n## ")[0]
    told = {}
    for line in re.findall(r"^\| `.*", section, re.MULTILINE):
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        listed = re.findall(r"`(\w+)`", cells[0])
        if "…" in cells[0]:
            stem = listed[0].removesuffix("p05")
            listed = [f"{stem}p{percent}" for percent in ("05", "25", "50", "75", "95")]
        told |= dict.fromkeys(listed, cells[1])
    assert told.keys() == SCHEMA.keys()
    assert {name: told[name] for name in RANGES} == {n: r.documented for n, r in RANGES.items()}
    assert RANGES.keys() == {name for name, dtype in SCHEMA.items() if dtype.is_numeric()}


@pytest.mark.parametrize(
    ("column", "value"),
    [
        *((name, limits.low - 1) for name, limits in RANGES.items()),
        *((name, 1.5 * limits.high) for name, limits in RANGES.items() if limits.high < 1e8),
    ],
)
def test_a_value_beyond_its_range_is_refused(written, column, value):
    with pytest.raises(ObservationError, match=f"'{column}' needs "):
        read_observations(written(**{column: [value, value]}))


def test_one_feature_twice_in_a_capture_with_other_values_is_refused(written):
    with pytest.raises(ObservationError, match=r"'f1' is there more than once in view 'v1' at 10"):
        read_observations(written(feature=["f1", "f1"], finish=["primer", "primer"]))


def test_a_further_column_tells_repeated_measurements_apart(written):
    path = written(feature=["f1", "f1"], attempt=[1, 2])
    assert len(read_observations(path)) == 2


@pytest.mark.parametrize("column", ["feature", "view", "sensor", "part", "finish", "tcp"])
@pytest.mark.parametrize("character", ["\x1b", "\x00", "\x9b", "\u202e"])
def test_control_characters_in_names_are_refused(written, column, character):
    with pytest.raises((FormatError, ObservationError)) as refused:
        read_observations(written(**{column: [f"a{character}[31m", "b"]}))
    assert character not in str(refused.value)
    with pytest.raises(ObservationError, match="without control characters"):
        table_of(replace(MEASURED, **{column: f"a{character}"}))


def test_the_bytes_of_a_csv_file_are_a_table(tmp_path):
    table = table_of(MEASURED, UNMEASURED)
    table.write(tmp_path / "table.csv")
    assert rows_of(parse_observations((tmp_path / "table.csv").read_bytes(), "a capture")) == (
        [MEASURED, UNMEASURED]
    )
    for nothing in (b"", b"feature,view\nf1,v1\n"):
        with pytest.raises(FormatError, match="a capture: "):
            parse_observations(nothing, "a capture")


@suffixes
def test_an_empty_table_comes_back(tmp_path, suffix):
    path = tmp_path / f"observations{suffix}"
    table_of().write(path)
    assert len(read_observations(path)) == 0


@suffixes
def test_features_whose_names_are_numbers_keep_them(tmp_path, suffix):
    rows = [replace(MEASURED, feature="007", view=str(2**63))] * 2
    table_of(*rows).write(tmp_path / f"table{suffix}")
    assert rows_of(read_observations(tmp_path / f"table{suffix}")) == rows


@suffixes
def test_a_suffix_in_capitals_is_the_same(tmp_path, suffix):
    path = tmp_path / f"table{suffix.upper()}"
    table_of(MEASURED).write(path)
    assert rows_of(read_observations(path)) == [MEASURED]


def test_columns_may_come_in_any_order(written):
    path = written()
    frame = pl.read_csv(path)
    frame.select(reversed(frame.columns)).write_csv(path)
    assert rows_of(read_observations(path)) == [MEASURED, UNMEASURED]


# -- tables made elsewhere ----------------------------------------------------------------------


@suffixes
def test_columns_after_the_radius_may_be_left_out(tmp_path, suffix):
    frame = table_of(MEASURED).frame.drop(OPTIONAL)
    path = tmp_path / f"table{suffix}"
    if suffix == ".csv":
        frame.write_csv(path)
    else:
        frame.write_parquet(path)
    (row,) = rows_of(read_observations(path))
    assert (row.visibility, row.emulated) == ("visible", False)
    assert np.isnan(row.incidence_deg)
    filled = ("n_points", "n_pixels", "i_std", "i_median", "i_p05", "i_p95", "clipped_share")
    assert {getattr(row, name) for name in filled} == {None}
    assert row == replace(MEASURED, **{name: getattr(row, name) for name in OPTIONAL})


def test_columns_that_are_wholly_empty_are_read_as_empty(written):
    names = OPTIONAL[OPTIONAL.index("i_mean") :]
    table = read_observations(written(**{name: [None, None] for name in names}))
    assert set(table.frame.select(names).row(0)) == {None}
    assert table.frame.schema == SCHEMA


def test_a_table_filled_in_so_can_be_written_and_read_again(written):
    path = written()
    pl.read_csv(path).head(1).drop(OPTIONAL).write_csv(path)
    table = read_observations(path)
    table.write(path)
    assert table.frame.equals(read_observations(path).frame)


def test_whole_numbers_are_taken_where_decimals_are_expected(written):
    assert read_observations(written(x_mm=[3, 4])).array(["x_mm"])[:, 0].tolist() == [3.0, 4.0]


# -- refused: files -----------------------------------------------------------------------------


def test_a_missing_file(tmp_path):
    with pytest.raises(MissingFileError, match=r"nothing\.csv: no such observation table"):
        read_observations(tmp_path / "nothing.csv")


@pytest.mark.parametrize("name", ["table.xlsx", "table"])
def test_another_suffix(tmp_path, name):
    path = tmp_path / name
    message = r"ends in \.csv or \.parquet, got '(\.xlsx)?'"
    with pytest.raises(FormatError, match=message):
        table_of(MEASURED).write(path)
    assert not path.exists()
    path.write_bytes(b"anything")
    with pytest.raises(FormatError, match=message):
        read_observations(path)


@suffixes
@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n\x00\xff\xfe", b"feature\n\xff\xff\n"])
def test_a_file_that_is_something_else(tmp_path, suffix, content):
    path = tmp_path / f"table{suffix}"
    path.write_bytes(content)
    with pytest.raises(
        FormatError,
        match=f"table{suffix}( is not a readable| is empty| holds zeros|: missing columns view)",
    ):
        read_observations(path)


def test_a_parquet_file_cut_short(tmp_path):
    path = tmp_path / "table.parquet"
    table_of(MEASURED).write(path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(FormatError, match="not a readable observation table"):
        read_observations(path)


@suffixes
@pytest.mark.parametrize("pattern", ["obs[1]", "obs?", "*", "obs[0-9]"])
def test_a_name_is_no_pattern(tmp_path, suffix, pattern):
    table_of(MEASURED, MEASURED).write(tmp_path / f"obs1{suffix}")
    named = tmp_path / f"{pattern}{suffix}"
    with pytest.raises(MissingFileError, match="no such observation table"):
        read_observations(named)
    table_of(UNMEASURED).write(named)
    assert read_observations(named).names("feature").tolist() == ["f2"]
    assert len(read_observations(tmp_path / f"obs1{suffix}")) == 2


@suffixes
def test_a_table_knows_the_checksum_of_the_bytes_it_was_read_from(tmp_path, suffix):
    path = tmp_path / f"table{suffix}"
    said = table_of(MEASURED).write(path)
    assert said == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read_observations(path).sha256 == said


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(FileError, match="does not exist; make it first"):
        table_of(MEASURED).write(tmp_path / "nowhere" / "table.csv")


# -- refused: header ----------------------------------------------------------------------------


def test_a_missing_column_is_named(written):
    path = written()
    pl.read_csv(path).drop("i_avg").write_csv(path)
    with pytest.raises(FormatError, match="missing column i_avg "):
        read_observations(path)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("i_avg", "i_avrg"),
        ("radius_mm", "raduis_mm"),
        ("clipped_share", "clip_share"),
        ("emulated", "emulate"),
        ("i_p05", "i_P05"),
        ("i_mean_p05", "imean_p05"),
        ("brightness_source", "brightness_sorce"),
        ("finish", "finnish"),
        ("i_mean", "i_men"),
    ],
)
def test_a_misspelt_column_is_recognised(written, right, wrong):
    path = written()
    path.write_text(path.read_text().replace(right, wrong, 1))
    with pytest.raises(FormatError, match=f"unknown column '{wrong}'; did you mean '{right}'"):
        read_observations(path)


@pytest.mark.parametrize("name", ["part_id", "part_a", "sensor_b", "tcp_x", "i_mean_p10"])
def test_a_further_word_or_number_is_another_column(written, name):
    path = written(**{name: [1.0, 2.0]})
    pl.read_csv(path).drop("part", "sensor", "tcp", "i_mean", "i_median").write_csv(path)
    assert read_observations(path).further_columns == (name,)


def test_a_decimal_comma_is_named(written):
    with pytest.raises(FormatError, match=r"a decimal point, got line 3, x_mm: '12,5'"):
        read_observations(written(x_mm=["1.5", "12,5"]))


# -- refused: values ----------------------------------------------------------------------------


def test_text_in_a_column_of_numbers(written):
    with pytest.raises(FormatError, match=r"expected numbers.*line 3, x_mm: 'left'"):
        read_observations(written(x_mm=["1.0", "left"]))


@pytest.mark.parametrize("name", ["n_points", "n_pixels"])
def test_a_fraction_in_a_column_of_whole_numbers(written, name):
    with pytest.raises(ObservationError, match=f"'{name}' needs whole numbers; row 2 .* has 3.5"):
        read_observations(written(**{name: [3.0, 3.5]}))


@pytest.mark.parametrize(
    "name",
    ["exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg", "radius_mm"],
)
@pytest.mark.parametrize(
    ("value", "message"),
    [
        (None, r"a value in every row; row 2 after the header is empty \(1 of 2 rows"),
        (np.nan, "finite numbers; row 2 after the header has nan"),
        (np.inf, "finite numbers; row 2 after the header has inf"),
    ],
)
def test_a_pose_or_exposure_that_is_no_number(written, name, value, message):
    with pytest.raises(ObservationError, match=f"column '{name}' needs {message}"):
        read_observations(written(**{name: [1.0, value]}))


@pytest.mark.parametrize("name", ["feature", "view", "visibility", "emulated"])
def test_a_row_without_a_name(written, name):
    value = True if name == "emulated" else "visible"
    with pytest.raises(ObservationError, match=f"'{name}' needs a value in every row; row 1"):
        read_observations(written(**{name: [None, value]}))


@pytest.mark.parametrize("value", [-0.01, 87.5, np.inf])
def test_p_norm_out_of_its_range(written, value):
    with pytest.raises(ObservationError, match=f"column 'p_norm' needs .*; row 1 .* has {value}"):
        read_observations(written(p_norm=[value, None]))


def test_p_norm_in_percent_is_told_what_to_do(written):
    with pytest.raises(ObservationError, match=r"a share, 0–1, .*\(divide percent by 100\)"):
        read_observations(written(p_norm=[87.5, 92.0]))


@pytest.mark.parametrize("name", ["i_avg", "i_median", "i_p05", "i_p95", "i_mean", "i_mod_p50"])
@pytest.mark.parametrize("value", [-1.0, 255.1, 4095.0])
def test_grey_values_out_of_their_range(written, name, value):
    with pytest.raises(ObservationError, match=f"'{name}' needs grey levels 0–255.*; row 1"):
        read_observations(written(**{name: [value, None]}))


@pytest.mark.parametrize("name", ["clipped_share", "stack_clipped_share", "low_modulation_share"])
@pytest.mark.parametrize("value", [-0.1, 1.5, 40.0])
def test_a_share_out_of_its_range(written, name, value):
    with pytest.raises(ObservationError, match=f"'{name}' needs a share, 0–1, .*; row 1"):
        read_observations(written(**{name: [value, None]}))


def test_an_unknown_source_of_brightness(written):
    with pytest.raises(
        ObservationError, match=r"'brightness_source' needs one of .* has 'stripes'"
    ):
        read_observations(written(brightness_source=["stripe", "stripes"]))


def test_quality_without_brightness(written):
    with pytest.raises(ObservationError, match="'i_avg' needs a value in every row that has a p"):
        read_observations(written(i_avg=[None, 12.0]))


@pytest.mark.parametrize("value", [0.0, -5.0])
def test_an_exposure_time_that_is_not_positive(written, value):
    with pytest.raises(ObservationError, match=r"'exposure_ms' needs .* above 0, .*; row 2"):
        read_observations(written(exposure_ms=[10.0, value]))


def test_a_negative_radius(written):
    with pytest.raises(ObservationError, match=r"'radius_mm' needs .* at least 0 .*; row 1"):
        read_observations(written(radius_mm=[-3.0, 5.0]))


def test_an_unknown_visibility(written):
    with pytest.raises(ObservationError, match=r"'visibility' needs one of 'visi.* has 'seen'"):
        read_observations(written(visibility=["visible", "seen"]))


def test_a_frame_of_other_columns():
    with pytest.raises(ObservationError, match=r"must have the columns feature, .*got feature;"):
        ObservationTable(frame=pl.DataFrame({"feature": ["f1"]}))


# -- selecting ----------------------------------------------------------------------------------


def test_measured_rows_are_the_visible_ones_with_a_quality():
    unknown = replace(MEASURED, feature="f3", p_norm=None)
    table = table_of(MEASURED, UNMEASURED, unknown).measured()
    assert rows_of(table) == [MEASURED]


def test_quality_is_selected_with_its_limit_included():
    qualities = (0.74, 0.75, 1.0)
    table = table_of(UNMEASURED, *(replace(MEASURED, p_norm=p) for p in qualities))
    assert table.with_quality(0.75).array(["p_norm"])[:, 0].tolist() == [0.75, 1.0]


def test_where_selects_rows_by_a_mask():
    table = table_of(MEASURED, UNMEASURED).where(np.array([False, True]))
    assert rows_of(table) == [UNMEASURED]


def test_array_has_columns_as_asked_and_nan_where_there_is_no_value():
    array = table_of(MEASURED, UNMEASURED).array(["z_mm", "i_avg", "n_points"])
    np.testing.assert_array_equal(array, [[30.0, 120.5, 90.0], [30.0, np.nan, np.nan]])


@pytest.mark.parametrize("column", ["feature", "brightness", "emulated"])
def test_array_of_something_else_than_numbers(column):
    with pytest.raises(ObservationError, match=f"no numeric column '{column}'"):
        table_of(MEASURED).array([column])


def test_counts_tell_each_visibility_the_commonest_first():
    table = table_of(UNMEASURED, MEASURED, MEASURED)
    assert list(table.counts().items()) == [
        (Visibility.VISIBLE.value, 2),
        (Visibility.FACING_AWAY.value, 1),
    ]


# -- further columns ----------------------------------------------------------------------------

FURTHER = {
    "operator": ["Ann", "Bo"],
    "i_p10": [101.5, None],
    "i_p25": [1, 2],
    'is "dry"': [True, None],
}


@suffixes
def test_further_columns_are_kept(tmp_path, written, suffix):
    table = read_observations(written(**FURTHER))
    assert table.further_columns == tuple(FURTHER)
    path = tmp_path / f"again{suffix}"
    table.write(path)
    again = read_observations(path)
    assert again.frame.equals(table.frame)
    assert again.measured().frame["operator"].to_list() == ["Ann"]
    assert again.array(["i_p10", "i_p25"])[0].tolist() == [101.5, 1.0]


def test_observations_carry_further_columns():
    rows = [replace(MEASURED, extra={"i_p10": 7.0}), replace(MEASURED, extra={"lens": "wide"})]
    table = table_of(*rows)
    assert table.frame.select("i_p10", "lens").rows() == [(7.0, None), (None, "wide")]
    assert ObservationTable.from_frame(table.frame.reverse()).further_columns == (
        "i_p10",
        "lens",
    )


def test_tables_are_put_one_below_the_other():
    one = table_of(replace(MEASURED, extra={"lens": "wide"}))
    table = ObservationTable.concat([one, table_of(UNMEASURED)])
    assert table.frame["lens"].to_list() == ["wide", None]
    assert len(ObservationTable.concat([])) == 0
    with pytest.raises(ObservationError, match="do not fit together"):
        ObservationTable.concat([one, table_of(replace(MEASURED, extra={"lens": True}))])


def test_a_further_column_of_something_else_is_refused():
    frame = table_of(MEASURED).frame.with_columns(pl.Series("pixels", [[1, 2]]))
    with pytest.raises(ObservationError, match="'pixels' must hold numbers, texts or truth values"):
        ObservationTable(frame=frame)


# -- made in Python -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"i_avg": 300.0}, "'i_avg' needs grey levels 0–255"),
        ({"p_norm": 92.0}, "divide percent by 100"),
        ({"exposure_ms": -1.0}, "'exposure_ms' needs values above 0"),
    ],
)
def test_values_are_checked_wherever_a_table_comes_from(values, message):
    with pytest.raises(ObservationError, match=message):
        table_of(replace(MEASURED, **values))
    frame = table_of(MEASURED).frame.with_columns(**{k: pl.lit(v) for k, v in values.items()})
    with pytest.raises(ObservationError, match=message):
        ObservationTable(frame=frame)


def test_positions_in_metres_and_repeated_rows_are_noticed():
    near = {"x_mm": 0.1, "y_mm": -0.05, "z_mm": 0.2}
    metres, repeated = table_of(*[replace(MEASURED, **near)] * 2).remarks()
    assert "in metres?" in metres
    assert "1 row of the table repeats" in repeated
    assert table_of(MEASURED, UNMEASURED).remarks() == ()


def test_a_notebook_shows_ranges_and_nothing_unescaped():
    shown = table_of(replace(MEASURED, extra={"<b>": 1.0}), UNMEASURED)._repr_html_()
    assert "2 observations" in shown
    assert "<td>120.5</td>" in shown
    assert "&lt;b&gt;" in shown
    assert table_of()._repr_html_()


# -- splitting ----------------------------------------------------------------------------------

GRID = [replace(MEASURED, feature=f"f{i}", view=f"v{j}") for i in range(5) for j in range(4)]


@pytest.mark.parametrize(("by", "groups"), [("feature", 5), ("view", 4)])
def test_a_split_keeps_groups_together(by, groups):
    train, test = table_of(*GRID).split(by=by, share=0.75, seed=3)
    names = set(train.names(by)), set(test.names(by))
    assert not names[0] & names[1]
    assert len(names[0]) == int(0.75 * groups)
    assert len(train) + len(test) == len(GRID)


def test_a_split_by_row_and_by_a_further_column():
    table = table_of(*(replace(row, extra={"day": f"d{i % 3}"}) for i, row in enumerate(GRID)))
    assert [len(side) for side in table.split(by="row", share=0.5)] == [10, 10]
    train, test = table.split(by="day", share=0.7)
    assert not set(train.names("day")) & set(test.names("day"))


def test_the_seed_decides_a_split():
    table = table_of(*GRID)
    sides = [table.split(seed=seed)[1].names("feature").tolist() for seed in (1, 1, 2, 3, 4)]
    assert sides[0] == sides[1]
    assert len(set(map(tuple, sides))) > 1


@pytest.mark.parametrize(
    ("rows", "settings", "error", "message"),
    [
        (GRID, {"share": 1.0}, InputError, "between 0 and 1"),
        (GRID, {"by": "featur"}, InputError, "did you mean 'feature'"),
        (GRID[:4], {"by": "feature"}, ObservationError, "leaves no feature to train or none"),
        ([], {}, ObservationError, "nothing to split"),
        ([UNMEASURED, MEASURED], {"share": 0.5}, ObservationError, "hold no measured observation"),
    ],
)
def test_a_split_that_cannot_be(rows, settings, error, message):
    with pytest.raises(error, match=message):
        table_of(*rows).split(**settings)


# -- what a model is asked about ----------------------------------------------------------------


def test_inputs_alone_can_be_read(tmp_path):
    path = tmp_path / "planned.csv"
    path.write_text("z_mm,i_avg,operator\n5,90,Ann\n-3.5,120,Bo\n")
    frame = read_inputs(path, ("i_avg", "z_mm"))
    assert frame.columns == ["feature", "view", "exposure_ms", "i_avg", "z_mm", "p_norm"]
    assert frame["i_avg"].to_list() == [90.0, 120.0]
    assert frame["feature"].to_list() == [None, None]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("i_avg\n90\n", r"planned\.csv: missing column z_mm"),
        ("i_avg,z_um\n90\n", "line 2 has 1"),
        ("i_avg,z_mm\nbright,0\n", "expected numbers.*line 2, i_avg: 'bright'"),
    ],
)
def test_inputs_that_are_not_there_are_named(tmp_path, text, message):
    path = tmp_path / "planned.csv"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        read_inputs(path, ("i_avg", "z_mm"))

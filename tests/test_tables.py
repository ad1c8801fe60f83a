"""A frame and its columns, as people read them and as CSV."""

import math

import pytest

from exposight.tables import Column, Table, count, counted, fixed, number


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "–"),
        (math.nan, "–"),
        (0.0, "0"),
        (-1.23456, "−1.235"),
        (123456.0, "123456"),
        (1.5e-7, "1.500e−07"),
        (2.5e6, "2.500e+06"),
    ],
)
def test_numbers_have_significant_digits(value, shown):
    assert number(value) == shown


def test_counts_and_decimals():
    assert (count(1234567), counted(1, "row"), counted(20, "row")) == (
        "1 234 567",
        "1 row",
        "20 rows",
    )
    assert fixed(-0.25, 1) == "−0.2"


@pytest.fixture
def table():
    return Table.of(
        "scores",
        [
            {"model": "q_k4", "target": "p_norm", "rmse": 0.151, "n": 1475, "right": True},
            {"model": "e_k6", "target": "exposure_ms", "rmse": 35.2, "n": 8, "right": None},
        ],
        (
            Column(name="model"),
            Column(name="rmse", digits=3, error_of="target"),
            Column(name="n"),
            Column(name="right"),
        ),
    )


def test_values_are_shown_in_the_unit_of_their_row_s_quantity(table):
    assert table.cells() == [("q_k4", "15.1 %", "1 475", "yes"), ("e_k6", "35.2 ms", "8", "–")]


@pytest.mark.parametrize(
    ("column", "heading"),
    [
        (Column(name="x_mm"), "x\nmm"),
        (Column(name="w_deg"), "w\n°"),
        (Column(name="depth_range_mm"), "depth range\nmm"),
        (Column(name="p_norm"), "p_norm"),
        (Column(name="log_likelihood"), "log likelihood"),
        (Column(name="seconds", label="s"), "s"),
    ],
)
def test_units_stand_below_the_headings(column, heading):
    assert column.heading == heading


def test_words_are_told_from_numbers(table):
    assert [table.is_text(column) for column in table.columns] == [True, False, False, True]


def test_a_table_prints_aligned_and_escapes_what_a_page_shows(table):
    head, first, _ = str(table).splitlines()
    assert head == "model     rmse      n  right"
    assert first == "q_k4    15.1 %  1 475  yes"
    assert Table.of("t", [{"a": "<b>"}], (Column(name="a"),))._repr_html_().count("&lt;b&gt;") == 1

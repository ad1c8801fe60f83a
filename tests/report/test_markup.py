import math

import pytest

from exposight.report.colours import P_NORM_SCALE, plotly_scale, scale_rgb
from exposight.report.markup import (
    Heading,
    exact,
    fixed,
    model_name,
    number,
    section,
    table,
    with_unit,
)
from exposight.report.plots import data_block


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.17284, 3, "0.173"),
        (17.284, 3, "17.3"),
        (1234.5678, 3, "1235"),
        (-3.25, 2, "−3.2"),
        (0.0, 3, "0"),
        (1.07e-8, 3, "1.07·10<sup>−8</sup>"),
        (4.2e9, 2, "4.2·10<sup>9</sup>"),
        (-2.5e-9, 2, "−2.5·10<sup>−9</sup>"),
        (None, 3, "–"),
        (math.nan, 3, "–"),
    ],
)
def test_numbers_have_significant_digits(value, digits, text):
    assert number(value, digits) == text


def test_exact_numbers_carry_every_digit():
    assert exact(0.1 + 0.2, "0.3") == '<data value="0.30000000000000004">0.3</data>'


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("q_k4", "<sup>q</sup><i>k</i><sub>4</sub>"),
        ("e_k6_star", "<sup>e</sup><i>k</i><sub>6</sub><sup>*</sup>"),
        ("e_k6_plus", "<sup>e</sup><i>k</i><sub>6</sub><sup>+</sup>"),
        ("e_k6_lin", "<sup>e</sup><i>k</i><sub>6</sub><sup>lin</sup>"),
        ("mine <1>", "mine &lt;1&gt;"),
    ],
)
def test_models_are_named_as_in_the_paper(name, text):
    assert model_name(name) == text


def test_neighbours_of_one_group_share_its_heading():
    headings = (Heading(text="a"), Heading(text="b", group="both"), Heading(text="c", group="both"))
    text = table(headings, [["1", "2", "3"]], name="t", caption="")
    assert text.count("both") == 1
    assert 'colspan="2" class="group">both</th>' in text


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ValueError, match="zip"):
        table((Heading(text="a"), Heading(text="b")), [["1"]], name="t", caption="")


def test_no_tag_hides_in_data():
    assert data_block("d", ["</script><b>&\u2028"]) == (
        '<script type="application/json" id="d">'
        '["\\u003c/script\\u003e\\u003cb\\u003e\\u0026\\u2028"]</script>\n'
    )


def test_a_scales_ends_and_middle_are_its_colours():
    colours = scale_rgb(P_NORM_SCALE, [-1.0, 0.0, 0.5, 1.0, 2.0])
    assert colours.tolist() == [[68, 1, 84], [68, 1, 84], [33, 145, 140], [253, 231, 37],
                                [253, 231, 37]]  # fmt: skip


def test_plotlys_scale_runs_from_0_to_1():
    scale = plotly_scale(P_NORM_SCALE)
    assert [scale[0], scale[-1]] == [[0.0, P_NORM_SCALE[0]], [1.0, P_NORM_SCALE[-1]]]


@pytest.mark.parametrize(
    ("value", "digits", "signed", "text"),
    [
        (1.25, 1, False, "1.2"),
        (-0.04, 1, True, "+0.0"),
        (-17.26, 1, True, "−17.3"),
        (3.0, 0, False, "3"),
        (None, 2, False, "–"),
        (math.inf, 2, False, "–"),
    ],
)
def test_fixed_numbers_have_that_many_decimals(value, digits, signed, text):
    assert fixed(value, digits, signed=signed) == text


def test_decimal_points_of_a_column_stand_below_each_other():
    headings = (Heading(text="a"), Heading(text="b"))
    cells = [exact(12.5, "12.5"), exact(0.125, "0.125"), exact(3, "3"), exact(None), "words"]
    text = table(headings, [["", cell] for cell in cells], name="t", caption="")
    assert '<data value="12.5" data-pad="00">12.5</data>' in text
    assert '<data value="0.125">0.125</data>' in text
    assert '<data value="3" data-pad=".000">3</data>' in text
    assert '<td><span data-pad=".000">–</span></td>' in text
    assert "<td>words</td>" in text


def test_a_column_of_whole_numbers_needs_no_padding():
    text = table((Heading(text="a"), Heading(text="b")), [["", exact(3, "3")], ["", "–"]],
                 name="t", caption="")  # fmt: skip
    assert "data-pad" not in text


@pytest.mark.parametrize(
    ("unit", "text"), [("ms²", "1 ms²"), ("°", "1°"), ("", "1"), ("<b>", "1 &lt;b&gt;")]
)
def test_a_space_stands_before_units_but_degrees(unit, text):
    assert with_unit("1", unit) == text


def test_a_number_and_its_unit_stay_on_one_line_but_data_stay_as_they_are():
    script = '<script type="application/json">"5 ms"</script>'
    body = f'5 ms, <data value="2.0">2</data> %, 3 msec, 7 views{script}'
    shown = section(1, "title", body)
    assert '5\u00a0ms, <data value="2.0">2</data>\u00a0%, 3 msec, 7 views' in shown
    assert script in shown

"""Numbers, names and sentences as pages show them."""

import math

import pytest
from markupsafe import Markup, escape

from exposight.report.rendering import (
    model_name,
    parameter_symbol,
    prose,
    render_page,
    rounded,
    significant,
    whole,
)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.17284, 3, "0.173"),
        (1234.5678, 3, "1235"),
        (-3.25, 2, "−3.2"),
        (0.0, 3, "0"),
        (1.07e-8, 3, "1.07·10<sup>−8</sup>"),
        (-2.5e9, 2, "−2.5·10<sup>9</sup>"),
        (None, 3, "–"),
        (math.nan, 3, "–"),
    ],
)
def test_numbers_have_significant_digits(value, digits, text):
    assert significant(value, digits).shown == text


@pytest.mark.parametrize(
    ("value", "decimals", "signed", "text"),
    [
        (1.25, 1, False, "1.2"),
        (-0.04, 1, True, "+0.0"),
        (-17.26, 1, True, "−17.3"),
        (None, 2, False, "–"),
        (math.inf, 2, False, "–"),
    ],
)
def test_rounded_numbers_have_that_many_decimals(value, decimals, signed, text):
    assert rounded(value, decimals, signed=signed).shown == text


def test_numbers_carry_every_digit():
    assert escape(rounded(0.1 + 0.2, 1)) == '<data value="0.30000000000000004">0.3</data>'
    assert escape(significant(0.25, factor=100)) == '<data value="0.25">25.0</data>'
    assert escape(whole(12345)) == '<data value="12345">12 345</data>'
    assert escape(whole(None)) == "–"
    assert Markup("{}").format(significant(1e-9)).count("<sup>") == 1


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("quality", "<i>quality</i>"),
        ("q_k1+e_k6", "<sup>q</sup><i>k</i><sub>1</sub> + <sup>e</sup><i>k</i><sub>6</sub>"),
        ("q_k4_s2", "<sup>q</sup><i>k</i><sub>4</sub><sup>s₂</sup>"),
        ("e_k6_plusplus", "<sup>e</sup><i>k</i><sub>6</sub><sup>++</sup>"),
        ("e_k6_lin", "<sup>e</sup><i>k</i><sub>6</sub><sup>lin</sup>"),
        ("mine <1>", "mine &lt;1&gt;"),
    ],
)
def test_models_are_named_as_in_the_paper(name, text):
    assert model_name(name) == text


def test_hyperparameters_have_symbols():
    assert parameter_symbol("variance", ()) == "σ²<sub>n</sub>"
    assert parameter_symbol("length_scale", ["i_avg"]) == "ℓ(<i>i</i><sub>avg</sub>)"
    assert parameter_symbol("<weight>", []) == "&lt;weight&gt;"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("the paper's i_avg", "the paper’s <i>i</i><sub>avg</sub>"),
        ("i_avg_other <x>", "i_avg_other &lt;x&gt;"),
    ],
)
def test_sentences_are_set_with_the_pages_letters(text, shown):
    assert prose(text) == shown


def test_a_missing_value_is_an_error_not_a_gap():
    with pytest.raises(Exception, match="is undefined"):
        render_page("campaign.html", title="t", lead="l")

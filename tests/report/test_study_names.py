"""How the study's page names models and quantities, and tells features apart."""

import pytest

from exposight.report.markup import model_name
from exposight.report.study.palette import feature_style, place_styles
from exposight.report.study.words import prose


def test_every_feature_of_the_paper_has_its_own_colour():
    names = [
        *(f"f{n}" for n in range(1, 10)),
        *(f"f{n}_test" for n in range(1, 5)),
        *(f"f{n}_out" for n in range(1, 6)),
    ]
    assert len({feature_style(name).colour for name in names}) == len(names)


def test_unseen_features_are_told_without_colour():
    assert feature_style("f1").filled
    assert not feature_style("f1_test").filled
    assert feature_style("f1_test").symbol == "circle-open"


def test_variants_are_called_as_in_the_paper():
    assert model_name("e_k6_plusplus") == "<sup>e</sup><i>k</i><sub>6</sub><sup>++</sup>"
    assert model_name("q_k4_s2") == "<sup>q</sup><i>k</i><sub>4</sub><sup>s₂</sup>"
    assert model_name("<b>") == "&lt;b&gt;"


def test_places_of_one_feature_are_told_by_line_and_shade():
    styles = place_styles(4)
    assert len({own.dash for own in styles}) == len({own.line for own in styles}) == 4
    assert [own.opacity for own in styles] == sorted((own.opacity for own in styles), reverse=True)
    assert styles[-1].opacity > 0.4


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("the paper's i_avg", "the paper’s <i>i</i><sub>avg</sub>"),
        ("i_avg_other <x>", "i_avg_other &lt;x&gt;"),
    ],
)
def test_findings_are_set_with_the_pages_letters(text, shown):
    assert prose(text) == shown

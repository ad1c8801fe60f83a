"""The catalogue of quantities: every column has an entry, and an unknown one is written safely."""

from exposight.observing import SCHEMA
from exposight.quantities import QUANTITIES, quantity


def test_every_numeric_column_of_an_observation_table_has_an_entry():
    assert {name for name, dtype in SCHEMA.items() if dtype.is_numeric()} == set(QUANTITIES)


def test_pictures_and_pages_write_a_quantity_alike():
    i_avg = quantity("i_avg")
    assert (i_avg.html, i_avg.math) == ("<i>i</i><sub>avg</sub>", r"$i_\mathrm{avg}$")
    assert quantity("exposure_ms").axis_html.endswith(" (ms)")
    assert quantity("exposure_ms").axis_math.endswith(" (ms)")


def test_the_unit_of_an_unknown_column_follows_from_its_name():
    assert (quantity("gap_mm").unit, quantity("gap_mm").symbol) == ("mm", "gap")
    assert quantity("other").unit == "1"
    assert quantity("a<b").html == "<i>a&lt;b</i>"

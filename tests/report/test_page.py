import re
from dataclasses import replace

import pytest

from exposight.cell import Cloud
from exposight.errors import CloudError, FileError, InputError
from exposight.report import write_report
from exposight.report.skull import skull_report

_LOADING = {"src", "srcset", "href", "action", "formaction", "data", "poster", "xlink:href"}


def test_the_same_result_gives_the_same_bytes(result, page):
    assert skull_report(result).encode() == page.encode()


def test_no_attribute_refers_to_an_address_outside(read_page):
    addresses = [
        value
        for _, attributes in read_page.tags
        for name, value in attributes.items()
        if name in _LOADING
    ]
    assert addresses
    assert all(value.startswith(("data:image/", "#")) for value in addresses)


def test_no_style_loads_anything(page):
    styles = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    assert len(styles) == 1
    assert not re.search(r"url\(|@import", styles[0])


def test_the_pages_own_script_loads_nothing(read_page):
    own = read_page.scripts[-1]["text"]
    assert "newPlot" in own
    assert not re.search(r"https?:|//cdn|import\s*\(|import\s+|fetch|XMLHttpRequest", own)


def test_the_browser_is_told_to_refuse_every_address(read_page):
    policy = next(
        attributes["content"]
        for tag, attributes in read_page.tags
        if tag == "meta" and attributes.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert "unsafe-eval" not in policy


def test_plotly_is_inlined_once(read_page):
    large = [script for script in read_page.scripts if len(script["text"]) > 1_000_000]
    assert len(large) == 1
    assert not large[0]["attributes"]


def test_the_title_and_the_head_say_what_the_page_is_of(page):
    told = "A recorded skull: point-cloud quality and exposure time, predicted"
    assert f"<title>{told}</title>" in page
    assert f"<h1>{told}</h1>" in page


def test_printing_draws_the_places_again_and_not_plotlys_own_parts(read_page):
    """Plotly's groups have the class "plot", too; asked to draw one of them it stops."""
    own = read_page.scripts[-1]["text"]
    assert 'querySelectorAll("div.plot")' in own
    assert 'querySelectorAll(".plot")' not in own


def test_ids_are_unique(read_page):
    ids = [attributes["id"] for _, attributes in read_page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_every_plot_has_its_data(read_page):
    places = [a["id"] for _, a in read_page.tags if a.get("class", "").split()[:1] == ["plot"]]
    assert places == ["cloud", "quality", "predicted-p_norm", "predicted-exposure_ms"]
    assert all(read_page.json(f"{place}-figure")["data"] for place in places)


def test_sections_and_figures_are_numbered_in_order(page):
    assert re.findall(r'<span class="no">(\d)</span>', page) == list("1234567")
    assert re.findall(r"<b>Figure (\d)\.</b>", page) == list("123456")


def test_names_are_shown_and_cannot_become_tags(read_page, page):
    assert "tiny <rig>" in read_page.texts
    assert "phase <shift>" in "".join(read_page.texts)
    assert not any(tag in ("x", "rig", "shift") for tag, _ in read_page.tags)
    assert "<x>" not in page


def test_a_features_name_reaches_the_figures_escaped(read_page):
    assert read_page.json("cloud-rings")["names"][0] == "&lt;x&gt;&amp;&quot;&#x27;&lt;/script&gt;"


def test_the_page_says_what_is_emulated_and_how_far_features_overlap(read_page):
    text = "".join(read_page.texts)
    assert "The exposure sweep is emulated" in text
    assert "scaled, rounded and clipped" in text
    assert "nominal 10 ms" in text
    assert "share 12 % of their pixels with training rings" in text


def test_write_puts_the_page_into_a_file(tmp_path, page):
    write_report(tmp_path / "report.html", page)
    assert (tmp_path / "report.html").read_bytes() == page.encode()


def test_write_says_that_the_folder_is_missing(tmp_path, page):
    with pytest.raises(FileError, match="does not exist; make it first"):
        write_report(tmp_path / "nowhere" / "report.html", page)


def test_an_unorganised_cloud_is_refused(result):
    flat = replace(result, cloud=Cloud(points=result.cloud.valid_points))
    with pytest.raises(CloudError, match="organised like the camera's image"):
        skull_report(flat)


def test_a_result_without_models_is_refused(result):
    with pytest.raises(InputError, match="at least one capture of the sweep and one trained model"):
        skull_report(replace(result, results=()))


def test_a_result_of_one_kind_of_model_still_has_a_page(result):
    only = tuple(own for own in result.results if own.model.name == "e_k1")
    page = skull_report(replace(result, results=only))
    assert 'id="unseen-exposure_ms"' in page
    assert 'id="unseen-p_norm"' not in page

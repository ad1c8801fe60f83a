import base64
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from exposight.errors import InputError
from exposight.report.door import door_report
from exposight.report.door.images import close_picture, framed_picture
from exposight.report.door.scene import ring_mesh, shading
from exposight.report.images import marked_picture
from exposight.report.markup import fixed


def _array(value):
    """An array as plotly writes it: a list, or typed bytes."""
    if isinstance(value, dict):
        flat = np.frombuffer(base64.b64decode(value["bdata"]), dtype=value["dtype"])
        return (
            flat.reshape([int(n) for n in value["shape"].split(",")]) if "shape" in value else flat
        )
    return np.asarray(value)


def _traces(read_door, name):
    return read_door.json(f"{name}-figure")["data"]


def test_the_same_result_gives_the_same_bytes(door_result, door_page):
    assert door_report(door_result) == door_page


def test_sections_and_figures_are_numbered_in_order(door_page):
    assert re.findall(r'<span class="no">(\d)</span>', door_page) == list("12345678")
    assert re.findall(r"<b>Figure (\d)\.</b>", door_page) == list("12345678")


def test_ids_are_unique_and_every_plot_has_its_data(read_door):
    ids = [attributes["id"] for _, attributes in read_door.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    places = [a["id"] for _, a in read_door.tags if a.get("class", "").split()[:1] == ["plot"]]
    assert places == [
        "door", "choice", "forecast", "quality", "predicted-p_norm", "predicted-exposure_ms",
    ]  # fmt: skip
    assert all(read_door.json(f"{place}-figure")["data"] for place in places)


def test_the_page_says_whose_numbers_these_are(read_door):
    text = "".join(read_door.texts)
    assert "The numbers are the simulated cell’s, not a real sensor’s" in text


def test_names_cannot_become_tags(door_page, read_door):
    assert "<x>" not in door_page
    assert not any(tag == "x" for tag, _ in read_door.tags)


@pytest.mark.parametrize("kind", ["predicted", "measured"])
@pytest.mark.parametrize("index", [0, 1, 2])
def test_rings_take_the_p_norm_of_their_choice(door_result, read_door, kind, index):
    (trace,) = (t for t in _traces(read_door, "door") if t.get("meta") == f"{kind}-{index}")
    view = door_result.new_view
    values = (view.taken.p_norm if kind == "predicted" else view.p_norm)[:, index]
    shown = _array(trace["intensity"]).reshape(len(view.views), -1)
    np.testing.assert_array_equal(shown, np.broadcast_to(values.astype("f4")[:, None], shown.shape))


def test_the_menu_has_every_choice_and_shows_the_forecast_first(read_door):
    options = [a for tag, a in read_door.tags if tag == "option"]
    door = [a["value"] for a in options if a["value"].startswith(("predicted-", "measured-"))]
    assert len(door) == 6
    shown = [t["meta"] for t in _traces(read_door, "door") if "meta" in t and t["visible"]]
    assert shown == ["predicted-1"] == [a["value"] for a in options if "selected" in a][:1]


def test_pointing_at_a_ring_tells_both_values(door_result, read_door):
    trace = next(t for t in _traces(read_door, "door") if t.get("meta") == "predicted-1")
    view = door_result.new_view
    hint = trace["text"][-1]
    assert f"predicted p<sub>norm</sub> {fixed(view.taken.p_norm[-1, 1], 3)} ±" in hint
    assert f"measured p<sub>norm</sub> {fixed(view.p_norm[-1, 1], 3)}" in hint


def test_rings_lie_round_their_holes(door_result):
    view = door_result.new_view
    points, faces = ring_mesh(view.views, view.captures[0].camera_from_part.inverse())
    assert faces.max() == len(points) - 1
    for own, band in zip(view.views, np.split(points, len(view.views)), strict=True):
        centre = own.feature.part_from_feature.translation_mm
        away = np.linalg.norm((band - centre)[:, :2], axis=1)
        radius_mm = own.feature.radius_mm
        np.testing.assert_allclose(away.min(), radius_mm + 1, atol=1e-3)  # float32 at 300 mm
        np.testing.assert_allclose(away.max(), radius_mm + 13, atol=1e-3)


def test_a_flat_sheet_is_evenly_shaded(door_result):
    vertices = door_result.mesh.vertices.copy()
    vertices[:, 2] = 0.0
    np.testing.assert_allclose(shading(vertices, door_result.mesh.faces), 0.5)


def test_the_forecast_figure_shows_what_was_predicted_and_measured(door_result, read_door):
    view = door_result.new_view
    traces = _traces(read_door, "forecast")
    for index, (predicted, measured) in enumerate(zip(traces[::2], traces[1::2], strict=True)):
        np.testing.assert_array_equal(_array(predicted["x"]), view.taken.p_norm[:, index])
        bars = _array(predicted["error_x"]["array"])
        np.testing.assert_array_equal(bars, 2 * view.taken.p_norm_std[:, index])
        np.testing.assert_array_equal(_array(measured["x"]), view.p_norm[:, index])


def test_the_choice_figure_shows_the_mean_over_features(door_result, read_door):
    view = door_result.new_view
    *_, mean, measured = _traces(read_door, "choice")
    np.testing.assert_array_equal(_array(mean["y"]), view.choice.p_norm.mean(axis=0))
    np.testing.assert_array_equal(_array(measured["y"]), view.p_norm.mean(axis=0))


def test_the_table_of_the_new_view_is_the_results(door_result, read_door):
    view, rows = door_result.new_view, read_door.rows["new-view"][2:]
    for i, row in enumerate(rows):
        expected = [view.views[i].feature.radius_mm, view.taken.wanted.mean[i]]
        expected.append(2 * view.taken.wanted.std[i])
        for j in range(3):
            expected += [
                view.taken.p_norm[i, j],
                2 * view.taken.p_norm_std[i, j],
                view.p_norm[i, j],
            ]
        expected += [view.taken.i_avg[i, 1], view.i_avg[i, 1]]
        assert [cell["value"] for cell in row[2:]] == expected
        known = view.views[i].feature.name in door_result.train_features
        assert row[1]["text"] == ("yes" if known else "no")


def test_the_cards_hold_the_results_numbers(door_result, door_page):
    cards = door_page[
        door_page.index('<div class="cards">') : door_page.index('<ul class="notes">')
    ]
    shown = [float(value) for value in re.findall(r'<data value="([^"]+)"', cards)]
    scores = {own.model.name: own.unseen.score.rmse for own in door_result.results}
    view = door_result.new_view
    assert shown[:4] == [3, len(door_result.table.measured()), scores["q_k1"], scores["q_k4"]]
    assert shown[-4:] == [
        view.p_norm[:, 1].mean(),
        view.taken.p_norm[:, 1].mean(),
        view.score.coverage_2sigma,
        view.score.rmse,
    ]


def test_frames_are_made_small_enough_for_a_page(door_result):
    picture = framed_picture(door_result.new_view, 1)
    assert picture.shape == (750, 1000, 3)


def test_a_close_picture_is_the_features_neighbourhood(door_result):
    view = door_result.new_view
    whole = marked_picture(view.captures[1])
    picture = close_picture(whole, view, 3, 1)
    seen = view.views[3]
    reach = int(max(np.ptp(seen.rows), np.ptp(seen.columns))) // 2 + 14
    row, column = int(seen.rows.mean()), int(seen.columns.mean())
    cut = whole[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    centre = cv2.resize(cut, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_NEAREST)[
        picture.shape[0] // 2, picture.shape[1] // 2
    ]
    np.testing.assert_array_equal(picture[picture.shape[0] // 2, picture.shape[1] // 2], centre)


def test_only_unseen_features_are_shown_close_by(door_result, read_door):
    shown = {a["alt"].partition(" at ")[0] for tag, a in read_door.tags if tag == "img"}
    names = {view.feature.name for view in door_result.new_view.views}
    assert shown & names == names - door_result.train_features


@pytest.mark.parametrize(
    ("value", "shown"), [(0.98765, "0.988"), (-0.0001, "0.000"), (-0.25, "−0.250"), (1e-9, "0.000")]
)
def test_shares_have_fixed_decimals_and_no_negative_zero(value, shown):
    assert fixed(value, 3) == shown


def test_a_result_without_models_is_refused(door_result):
    with pytest.raises(InputError, match="at least one trained model"):
        door_report(replace(door_result, results=()))

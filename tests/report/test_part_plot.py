"""The part in 3D: rings where the features are, in the colours of their quality."""

import json

import numpy as np
import plotly.graph_objects as go
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.report.figures import Plot
from exposight.report.part_plot import label_places, ring_mesh, shading

EXTENT = 1000.0


def _places(*rings):
    names, centres = [name for name, *_ in rings], np.array([own[1:] for own in rings], float)
    return label_places(names, centres.reshape(-1, 2), np.full(len(names), 20.0), EXTENT)


def test_a_ring_alone_has_its_name_above():
    ((x, y, side),) = _places(("f1", 5.0, 7.0))
    assert (x, side) == (5.0, "top center")
    assert y < 7.0 - 20.0


def test_a_ring_above_pushes_the_name_below():
    places = _places(("f1", 0.0, 0.0), ("f2", 0.0, -45.0))
    assert [side for _, _, side in places] == ["bottom center", "top center"]


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-400, 400), st.floats(-300, 300)), min_size=1, max_size=8))
def test_every_name_stands_beside_its_own_ring(centres):
    places = _places(*((f"f{i}", *own) for i, own in enumerate(centres)))
    away = [
        np.hypot(x - own[0], y - own[1]) for (x, y, _), own in zip(places, centres, strict=True)
    ]
    np.testing.assert_allclose(away, 24.0)  # the ring's radius and a small gap


@pytest.mark.parametrize("kind", ["predicted", "measured"])
@pytest.mark.parametrize("index", [0, 1, 2])
def test_rings_take_the_p_norm_of_their_choice(report, read_page, kind, index):
    (trace,) = (t for t in read_page.traces("part") if t.get("meta") == f"{kind}-{index}")
    view = report.view
    values = (view.forecast.taken.p_norm if kind == "predicted" else view.p_norm)[:, index]
    shown = read_page.array(trace["intensity"]).reshape(len(view.features), -1)
    np.testing.assert_array_equal(shown, np.broadcast_to(values.astype("f4")[:, None], shown.shape))


def test_the_menu_has_every_choice_and_shows_the_forecast_first(report, read_page):
    options = [a for tag, a in read_page.tags if tag == "option"][:6]
    assert [a["value"].partition("-")[0] for a in options] == ["predicted"] * 3 + ["measured"] * 3
    shown = [t["meta"] for t in read_page.traces("part") if "meta" in t and t["visible"]]
    assert shown == [f"predicted-{report.view.main}"]
    assert [a["value"] for a in options if "selected" in a] == shown


def test_pointing_at_a_ring_tells_both_values(report, read_page):
    hint = next(t for t in read_page.traces("part") if t.get("meta") == "predicted-1")["text"][-1]
    assert f"{report.view.forecast.taken.p_norm[-1, 1]:.2f} (2σ: " in hint
    assert f"measured p<sub>norm</sub> {report.view.p_norm[-1, 1]:.2f}" in hint


def test_rings_lie_round_their_features(report):
    view = report.view
    points, faces = ring_mesh(view.tcp_from_feature, view.radii_mm, EXTENT)
    assert faces.max() == len(points) - 1
    bands = np.split(points, len(view.features))
    for pose, radius_mm, band in zip(view.tcp_from_feature, view.radii_mm, bands, strict=True):
        away = np.linalg.norm((band - pose.translation_mm)[:, :2], axis=1)
        np.testing.assert_allclose(away.min(), radius_mm + 1, atol=1e-3)
        np.testing.assert_allclose(away.max(), radius_mm + 13, atol=1e-3)


def test_poses_in_the_table_are_those_of_the_captures(report):
    for pose, mask in zip(report.view.tcp_from_feature, report.view.views, strict=True):
        np.testing.assert_allclose(pose.to_matrix(), mask.tcp_from_feature.to_matrix(), atol=1e-9)


def test_the_scene_is_upright_and_to_scale(read_page):
    scene = read_page.json("part-figure")["layout"]["scene"]
    top, bottom = scene["zaxis"]["range"][::-1]
    assert top < bottom  # the camera's y points down, so the axis is turned over
    spans = [abs(np.ptp(scene[f"{name}axis"]["range"])) for name in "xyz"]
    ratio = [scene["aspectratio"][name] for name in "xyz"]
    np.testing.assert_allclose(np.divide(ratio, spans), ratio[0] / spans[0])
    assert all(" (mm)" in scene[f"{name}axis"]["title"]["text"] for name in "xyz")


def test_a_flat_sheet_is_evenly_shaded(report):
    vertices = report.mesh.vertices.copy()
    vertices[:, 2] = 0.0
    np.testing.assert_allclose(shading(vertices, report.mesh.faces), 0.5)


def test_no_tag_hides_in_data():
    text = "</script><b>&\u2028"
    json_text = str(Plot.of("part", go.Figure(layout={"title": {"text": text}})).json)
    assert not set("<>&\u2028") & set(json_text)
    assert json.loads(json_text)["layout"]["title"]["text"] == text

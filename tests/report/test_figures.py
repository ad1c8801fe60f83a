import base64

import numpy as np
import pytest

from exposight.report.skull.cloud import ring_of_points
from exposight.report.skull.selection import object_crop, sample_cloud


def _array(value):
    """An array as plotly writes it: a list, or typed bytes."""
    if isinstance(value, dict):
        return np.frombuffer(base64.b64decode(value["bdata"]), dtype=value["dtype"])
    return np.asarray(value)


def _traces(read_page, name):
    return read_page.json(f"{name}-figure")["data"]


def test_the_3d_points_are_the_clouds(result, read_page):
    traces = _traces(read_page, "cloud")
    shown = {
        tuple(point)
        for trace in traces
        # plotly's y is the camera's depth, its z the camera's y
        for point in np.column_stack([_array(trace[name]) for name in ("x", "z", "y")]).tolist()
    }
    assert shown == {tuple(point) for point in result.cloud.valid_points.tolist()}


def test_the_skull_stands_upright(read_page):
    top, bottom = read_page.json("cloud-figure")["layout"]["scene"]["zaxis"]["range"][::-1]
    assert top < bottom  # the camera's y points down, so the axis is turned over


def test_the_3d_scene_is_to_scale(read_page):
    scene = read_page.json("cloud-figure")["layout"]["scene"]
    spans = [abs(np.ptp(scene[f"{name}axis"]["range"])) for name in "xyz"]
    ratio = [scene["aspectratio"][name] for name in "xyz"]
    np.testing.assert_allclose(np.divide(ratio, spans), ratio[0] / spans[0])


def test_the_slider_has_every_value_of_every_feature(result, read_page):
    rings = read_page.json("cloud-rings")
    table = result.table.measured()
    order = [view.feature.name for view in result.views]
    for column in ("p_norm", "i_avg"):
        values = table.array([column])[:, 0].reshape(len(rings["labels"]), len(order))
        np.testing.assert_allclose(rings[column], values, atol=5e-5)  # four digits are kept


def test_the_slider_tells_recorded_from_emulated(read_page):
    assert read_page.json("cloud-rings")["labels"] == [
        "4.22 ms, emulated", "10.0 ms, recorded", "23.7 ms, emulated",
    ]  # fmt: skip


def test_a_point_belongs_to_the_ring_whose_mask_covers_it(result):
    sample = sample_cloud(result, object_crop(result), 100_000)
    rings = ring_of_points(result, sample)
    for index, view in enumerate(result.views):
        covered = set(zip(view.rows.tolist(), view.columns.tolist(), strict=True))
        mine = rings == index
        found = zip(sample.rows[mine].tolist(), sample.columns[mine].tolist(), strict=True)
        assert set(found) == covered  # the nominal cloud is whole, and no two rings overlap


def test_every_observation_is_drawn_over_brightness(result, read_page):
    markers = [trace for trace in _traces(read_page, "quality") if trace["mode"] == "markers"]
    drawn = np.concatenate(
        [np.column_stack([_array(trace["x"]), _array(trace["y"])]) for trace in markers]
    )
    table = result.table.measured().array(["i_avg", "p_norm"])
    np.testing.assert_array_equal(np.sort(drawn, axis=0), np.sort(table, axis=0))


def test_the_curve_and_its_band_are_the_models(result, read_page):
    high, low, mean = (t for t in _traces(read_page, "quality") if t["mode"] == "lines")
    model = next(own.model for own in result.results if own.model.name == "q_k1")
    prediction = model.predict(_array(mean["x"])[:, None])
    np.testing.assert_array_equal(_array(mean["y"]), prediction.mean)
    np.testing.assert_allclose(_array(high["y"]) - _array(low["y"]), 4 * prediction.std, rtol=1e-12)


@pytest.mark.parametrize("model", ["q_k1", "q_k4", "e_k1"])
def test_predictions_are_drawn_over_observations(result, read_page, model):
    own = next(own for own in result.results if own.model.name == model)
    traces = [
        trace
        for trace in _traces(read_page, f"predicted-{own.model.target}")
        if trace.get("meta") == model
    ]
    drawn = np.concatenate(
        [
            np.column_stack([_array(t["x"]), _array(t["y"]), _array(t["error_y"]["array"])])
            for t in traces
        ]
    )
    prediction = own.unseen.prediction
    expected = np.column_stack([own.unseen.observed, prediction.mean, 2 * prediction.std])
    np.testing.assert_array_equal(
        np.sort(drawn, axis=0), np.sort(expected.astype(np.float32), axis=0)
    )


def test_only_the_chosen_model_is_shown_at_first(read_page):
    shown = {
        trace["meta"]
        for trace in _traces(read_page, "predicted-p_norm")
        if "meta" in trace and trace["visible"]
    }
    assert shown == {"q_k4"}


def test_extrapolations_have_another_marker(result, read_page):
    own = next(own for own in result.results if own.model.name == "e_k1")
    symbols = {
        trace["marker"]["symbol"]: len(_array(trace["x"]))
        for trace in _traces(read_page, "predicted-exposure_ms")
        if trace.get("meta") == "e_k1"
    }
    inside = int(own.unseen.prediction.inside.sum())
    assert symbols == {"circle": inside, "diamond-open": len(own.unseen.observed) - inside}


def test_every_axis_has_a_unit(read_page):
    for name in ("quality", "predicted-p_norm", "predicted-exposure_ms"):
        layout = read_page.json(f"{name}-figure")["layout"]
        for axis in ("xaxis", "yaxis"):
            assert layout[axis]["title"]["text"].endswith((" (1)", " (ms)", " (grey level 0–255)"))
    scene = read_page.json("cloud-figure")["layout"]["scene"]
    assert all(" (mm)" in scene[f"{name}axis"]["title"]["text"] for name in "xyz")

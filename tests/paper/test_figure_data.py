"""The figures' arrays against small cases made by hand."""

import numpy as np
import pytest

from exposight.errors import InputError, ObservationError
from exposight.models import Prediction, model_named
from exposight.observing import Observation, ObservationTable
from exposight.paper.figure_data import kernel_examples
from exposight.paper.observed_curves import (
    extreme_radii,
    feature_positions,
    nearest_row,
    observed_curves,
)
from exposight.paper.prediction_surfaces import prediction_surfaces
from exposight.paper.predictions import best_and_worst, capture_forecast


def row(feature, view, exposure_ms, *, i_avg=None, p_norm=0.9, place=(0.0, 0.0, 0.0), radius=8.0):
    x, y, z = place
    return Observation(
        feature=feature,
        view=view,
        exposure_ms=exposure_ms,
        p_norm=p_norm,
        i_avg=4.0 * exposure_ms if i_avg is None else i_avg,
        x_mm=x,
        y_mm=y,
        z_mm=z,
        w_deg=1.0,
        p_deg=-1.0,
        r_deg=0.0,
        radius_mm=radius,
        visibility="visible" if p_norm is not None else "out of frame",
    )


def table(*rows):
    return ObservationTable.from_observations(rows)


def sweep(feature, view, exposures_ms=(5.0, 10.0, 20.0, 40.0), **more):
    return [row(feature, view, exposure_ms, **more) for exposure_ms in exposures_ms]


class Fake:
    """A model that predicts what a function of its inputs says, ±1."""

    def __init__(self, name, answer, trained):
        self.specification = model_named(name)
        self.name, self.target = name, self.specification.target
        self.inputs = self.specification.inputs
        self.answer = answer
        self.trained = np.array(trained, dtype=float)

    def predict(self, rows=None, /, **columns):
        if rows is not None:
            columns = dict(zip(self.inputs, rows.array(self.inputs).T, strict=True))
        inputs = np.stack([columns[name] for name in self.inputs], axis=1)
        mean = np.asarray(self.answer(inputs), dtype=float)
        inside = np.ones(len(mean), dtype=bool)
        return Prediction(mean=mean, std=np.ones(len(mean)), inside=inside)

    @property
    def training_data(self):
        return dict(zip(self.inputs, self.trained.T, strict=True))

    @property
    def training_range(self):
        return {name: (low.min(), low.max()) for name, low in self.training_data.items()}


# -- curves -------------------------------------------------------------------------------------


def test_a_curve_has_one_feature_and_view_by_growing_exposure():
    observed = table(row("f2", "a", 7), row("f1", "b", 9), row("f1", "a", 20), row("f1", "a", 5))
    curves = observed_curves(observed)
    assert [(own.feature, own.view) for own in curves] == [("f1", "a"), ("f1", "b"), ("f2", "a")]
    assert curves[0].exposure_ms.tolist() == [5, 20]
    assert curves[0].i_avg.tolist() == [20, 80]


def test_rows_that_were_not_measured_are_in_no_curve():
    assert observed_curves(table(row("f1", "a", 5, p_norm=None, i_avg=None))) == ()


def test_the_slope_of_a_proportional_curve():
    (curve,) = observed_curves(table(*sweep("f1", "a")))
    assert curve.slope_ms == pytest.approx(0.25)


def test_the_smallest_and_the_largest_feature():
    radii = {"f1": 8.0, "f2": 3.0, "f3": 30.0}
    rows = [row(name, "a", 5, radius=radius) for name, radius in radii.items()]
    chosen = extreme_radii(observed_curves(table(*rows)))
    assert [own.feature for own in chosen] == ["f2", "f3"]


def test_the_row_nearest_to_the_axis_by_growing_x():
    places = {
        "a": (75.0, -50.0, -5.0),
        "b": (-75.0, -52.0, -4.0),
        "c": (0.0, 50.5, -5.0),
        "d": (0.0, 0.0, 155.0),
        "e": (10.0, -47.0, -3.0),
    }
    rows = [own for view, place in places.items() for own in sweep("f1", view, place=place)]
    found = nearest_row(observed_curves(table(*rows)))
    assert [own.view for own in found] == ["b", "e", "a"]


def test_a_row_of_three_places_is_preferred_to_a_nearer_one():
    near = sweep("f1", "near", place=(0.0, 0.0, 0.0))
    row_ = [own for x in (1.0, 2.0, 3.0) for own in sweep("f2", f"v{x}", place=(x, 90.0, 0.0))]
    assert {own.feature for own in nearest_row(observed_curves(table(*near, *row_)))} == {"f2"}


def test_a_row_needs_two_exposures_of_one_view():
    with pytest.raises(ObservationError, match="two exposure times of one view, got 1 curves"):
        nearest_row(observed_curves(table(row("f1", "a", 5))))


def test_a_position_for_each_view():
    rows = sweep("f1", "a", place=(1.0, 2.0, 3.0)) + sweep("f1", "b", place=(4.0, 5.0, 6.0))
    (own,) = feature_positions(table(*rows))
    assert own.positions_mm.tolist() == [[1, 2, 3], [4, 5, 6]]


# -- predictions --------------------------------------------------------------------------------


@pytest.fixture
def four_views():
    """Curves that a model saying 0.25 ms per grey level misses by 0, 1, 2 and 30 ms."""
    rows = []
    for view, error in (("c", 2.0), ("a", 0.0), ("d", 30.0), ("b", 1.0)):
        rows += [
            row("f1_test", view, 0.25 * grey + error, i_avg=grey) for grey in (20.0, 40, 60, 80)
        ]
    return table(*rows)


@pytest.fixture
def proportional():
    return Fake("e_k4", lambda x: 0.25 * x[:, 0], [[10, -1, -1, -1], [100, 1, 1, 1]])


def test_best_and_worst_curves_by_rmse(four_views, proportional):
    shown = best_and_worst("e_k4", proportional, "eX_test", four_views)
    assert [own.observed.view for own in shown.best] == ["a", "b"]
    assert [own.observed.view for own in shown.worst] == ["d", "c"]
    assert [own.rmse for own in shown.worst] == pytest.approx([30.0, 2.0])
    assert [own.covered for own in (*shown.best, *shown.worst)] == [4, 4, 0, 4]
    assert shown.judged == 4


def test_a_predicted_curve_is_drawn_over_the_trained_brightness(four_views, proportional):
    drawn = best_and_worst("e_k4", proportional, "eX_test", four_views).best[0]
    assert (drawn.i_avg[0], drawn.i_avg[-1]) == (10, 100)
    assert drawn.mean == pytest.approx(0.25 * drawn.i_avg)


def test_curves_outside_the_trained_range_can_be_left_out(four_views, proportional):
    moved = table(*sweep("f2_test", "far", place=(5.0, 0.0, 0.0)))
    both = ObservationTable(frame=four_views.frame.vstack(moved.frame))
    everything = best_and_worst("e_k4", proportional, "eX_test", both)
    inside = best_and_worst("e_k4", proportional, "eX_test", both, inside_only=True)
    assert (everything.judged, inside.judged) == (5, 4)
    outside = [own for own in (*everything.best, *everything.worst) if not own.inside]
    assert [own.observed.view for own in outside] == ["far"]


def test_flat_curves_can_be_left_out():
    model = Fake("q_k4", lambda x: 0 * x[:, 0], [[10, -1, -1, -1], [100, 1, 1, 1]])
    rising = [row("f1_test", "a", t, p_norm=p) for t, p in ((5, 0), (10, 0.4), (20, 0.9), (40, 1))]
    shown = best_and_worst(
        "q_k4", model, "X_test", table(*rising, *sweep("f1_test", "b")), least_range=0.5
    )
    assert [own.observed.view for own in shown.best] == ["a"]
    assert shown.worst == ()


def test_too_few_exposures_for_a_curve(proportional):
    with pytest.raises(ObservationError, match="curves of at least 4 exposure times"):
        best_and_worst("e_k4", proportional, "eX_test", table(row("f1", "a", 5)))


def test_the_capture_that_shows_most_features_well(proportional):
    quality = Fake("q_k4", lambda x: 0.5 + 0 * x[:, 0], proportional.trained)
    rows = [
        *(row(f"f{i}_test", "dark", 27.0, p_norm=0.1) for i in (1, 2, 3)),
        *(row(f"f{i}_test", "good", t, p_norm=0.9) for i in (2, 1) for t in (5.0, 30.0)),
        row("f3_test", "single", 27.0, p_norm=1.0),
    ]
    shown = capture_forecast(("q_k4", quality), ("e_k4", proportional), table(*rows))
    assert (shown.view, shown.exposure_ms) == ("good", 30.0)
    assert [own.feature for own in shown.features] == ["f1_test", "f2_test"]
    assert shown.features[0].exposure_mean_ms == pytest.approx(30.0)
    assert shown.features[0].p_norm_mean == pytest.approx(0.5)
    assert shown.features[0].inside


def test_no_capture_without_measured_rows(proportional):
    nothing = table(row("f1", "a", 5, p_norm=None))
    with pytest.raises(ObservationError, match="no measured row among 1"):
        capture_forecast(("q_k4", proportional), ("e_k4", proportional), nothing)


# -- surfaces, kernels --------------------------------------------------------------------------


def test_surfaces_lie_at_their_brightness_depth_and_place():
    def answer(inputs):
        grey, z, x, y = inputs.T  # e_k4's order
        return 1e6 * grey + 1e3 * z + x + 1e-3 * y

    model = Fake("e_k4", answer, [[10, -160, -100, -50], [100, 170, 100, 50]])
    data = prediction_surfaces("e_k4", model, "stereo")
    assert (data.x_mm[0], data.x_mm[-1], data.y_mm[0], data.y_mm[-1]) == (-100, 100, -50, 50)
    i, j, k, m = 2, 0, 4, 7
    expected = 1e6 * 125 - 1e3 * 150 + data.x_mm[m] + 1e-3 * data.y_mm[k]
    assert data.mean[i, j, k, m] == pytest.approx(expected, rel=1e-12)


def test_surfaces_of_six_inputs_face_the_feature_squarely():
    model = Fake("e_k6", lambda x: np.abs(x[:, 4:]).sum(axis=1), np.eye(6))
    assert prediction_surfaces("e_k6", model, "stereo").mean.max() == 0


def test_training_places_are_shown_with_their_depth():
    model = Fake("e_k4", lambda x: x[:, 0], [[10, -160, 1, 2], [10, -160, 1, 2], [100, 170, 3, 4]])
    near, middle, far = prediction_surfaces("e_k4", model, "stereo").trained_mm
    assert (near.tolist(), middle.tolist(), far.tolist()) == ([[1, 2]], [], [[3, 4]])


def test_a_model_without_position_has_no_surfaces():
    model = Fake("e_k1", lambda x: x[:, 0], [[1], [2]])
    with pytest.raises(InputError, match="a model that reads x_mm, y_mm, z_mm; e_k1 reads i_avg"):
        prediction_surfaces("e_k1", model, "stereo")


def test_kernels_agree_where_observed_and_doubt_beyond():
    for own in kernel_examples().examples:
        assert len(own.x_train) == 7
        assert own.truth == pytest.approx(own.x * np.sin(2 * np.pi * own.x))
        between = (own.x > 0) & (own.x < 1.2)
        assert np.abs(own.mean - own.truth)[between].max() < 0.2  # four times the noise
        assert own.std[-1] > 5 * own.std[between].max()

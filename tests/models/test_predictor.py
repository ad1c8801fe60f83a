"""The contract: inputs by name, any columns, and kinds of predictors that strangers add."""

from dataclasses import dataclass

import numpy as np
import polars as pl
import pytest

from exposight.errors import FormatError, InputError, ObservationError
from exposight.models import (
    GaussianProcessModel,
    Prediction,
    Predictor,
    Provenance,
    evaluate,
    input_array,
    load_model,
    model_named,
    register_predictor,
    save_model,
)

POSE = {"z_mm": 0.0, "x_mm": 25.0, "y_mm": -10.0}


@register_predictor
@dataclass(frozen=True, kw_only=True, eq=False)
class Nearest(Predictor):
    """Predicts the target of the nearest training row."""

    kind = "tests/nearest"

    x: np.ndarray
    y: np.ndarray
    noise: float = 1.0

    @classmethod
    def train(cls, table, *, name, target, inputs):
        rows = table.measured()
        return cls(
            name=name,
            title="nearest",
            target=target,
            inputs=inputs,
            provenance=Provenance.of(rows),
            x=rows.array(inputs),
            y=rows.array([target])[:, 0],
        )

    def predict_frame(self, frame):
        distance = np.linalg.norm(input_array(self.name, frame)[:, None] - self.x, axis=2)
        nearest, std = distance.argmin(axis=1), distance.min(axis=1)
        return Prediction(mean=self.y[nearest], std=self.noise + std, inside=std < 10.0)


@pytest.fixture
def nearest(table):
    return Nearest.train(table, name="near", target="p_norm", inputs=("x_mm", "i_avg"))


def test_a_band_is_two_standard_deviations_unless_it_is_given():
    mean, inside = np.array([1.0, 2.0]), np.array([True, True])
    plain = Prediction(mean=mean, std=np.array([0.5, 1.0]), inside=inside)
    np.testing.assert_array_equal([plain.low, plain.high], [[0.0, 0.0], [2.0, 4.0]])
    one_sided = Prediction(mean=mean, std=mean, inside=inside, low=0.9 * mean)
    np.testing.assert_array_equal([one_sided.low, one_sided.high], [0.9 * mean, 3.0 * mean])


# -- by name ------------------------------------------------------------------------------------


def test_table_frame_and_keywords_predict_the_same(trained, table):
    model = trained(model_named("q_k4"))
    frame = table.frame.select(reversed(table.frame.columns))
    columns = {name: frame[name].to_numpy() for name in frame.columns if name.endswith("_mm")}
    for other in (model.predict(frame), model.predict(**columns, i_avg=table.frame["i_avg"])):
        np.testing.assert_array_equal(other.mean, model.predict(table).mean)
        np.testing.assert_array_equal(other.std, model.predict(table).std)


def test_single_values_hold_for_all_rows(trained):
    model = trained(model_named("q_k4"))
    both = model.predict(i_avg=[80.0, 90.0], **POSE)
    assert model.predict(i_avg=80, **POSE).mean[0] == pytest.approx(both.mean[0], rel=1e-12)
    assert both.mean.shape == (2,)


def test_columns_that_a_model_does_not_read_are_ignored(trained):
    model = trained(model_named("q_k1"))
    assert model.predict(i_avg=80.0, **POSE).mean == model.predict(i_avg=80.0).mean


def test_no_rows_no_predictions(trained, table):
    rows = table.where(np.zeros(len(table), dtype=bool))
    assert trained(model_named("q_k2")).predict(rows).mean.shape == (0,)


@pytest.mark.parametrize(
    ("columns", "error", "message"),
    [
        ({"iavg": 80.0, "z_mm": 0.0}, InputError, r"not read 'iavg'.*did you mean 'i_avg'"),
        ({"i_avg": 80.0}, ObservationError, "missing z_mm"),
        ({"i_avg": [1.0, 2.0], "z_mm": [1.0, 2.0, 3.0]}, InputError, "vectors of one length"),
        ({"i_avg": np.nan, "z_mm": 0.0}, ObservationError, r"'i_avg' must hold finite .* row 1"),
        ({"i_avg": 256.0, "z_mm": 0.0}, ObservationError, "grey levels from 0 to 255"),
        ({"i_avg": ["bright"], "z_mm": 0.0}, ObservationError, "'i_avg' must hold numbers"),
    ],
)
def test_inputs_that_cannot_be(trained, columns, error, message):
    with pytest.raises(error, match=message):
        trained(model_named("q_k2")).predict(**columns)


def test_inputs_by_position_are_refused(trained):
    with pytest.raises(InputError, match="reads columns by name"):
        trained(model_named("q_k2")).predict(np.zeros((1, 2)))


def test_a_table_and_columns_at_once_are_refused(trained, table):
    with pytest.raises(InputError, match="got both"):
        trained(model_named("q_k2")).predict(table, i_avg=80.0)


# -- hyperparameters ----------------------------------------------------------------------------


def test_hyperparameters_say_what_they_act_on_and_their_unit(trained):
    described = {
        (each.quantity, each.inputs): (each.unit, each.remark)
        for each in trained(model_named("e_k6")).hyperparameters()
    }
    assert described["length_scale", ("i_avg",)][0] == "grey levels"
    assert described["length_scale", ("w_deg",)][0] == "°"
    assert described["variance", ()][0] == "ms²"
    assert ("", "fixed") in described.values()


def test_one_length_scale_of_several_units_is_mixed(trained):
    parameters = trained(model_named("e_k2")).hyperparameters()
    assert [each.unit for each in parameters if each.quantity == "length_scale"] == ["mixed"]


# -- kinds that strangers add --------------------------------------------------------------------


def test_a_foreign_predictor_is_kept_and_predicts_the_same(tmp_path, nearest, table):
    path = tmp_path / "near.exposight-model"
    save_model(path, nearest)
    again = load_model(path)
    assert isinstance(again, Nearest)
    assert (again.name, again.target, again.inputs) == ("near", "p_norm", ("x_mm", "i_avg"))
    assert again.provenance == nearest.provenance
    assert again.noise == 1.0
    np.testing.assert_array_equal(again.predict(table).mean, nearest.predict(table).mean)


def test_a_foreign_predictor_is_evaluated_like_others(nearest, table):
    evaluation = evaluate(nearest, table)
    assert evaluation.score.rmse == 0.0
    assert evaluation.model is nearest
    assert nearest.unit == "1"


def test_a_model_of_another_kind_than_wanted_is_refused(tmp_path, nearest):
    path = tmp_path / "near.exposight-model"
    save_model(path, nearest)
    with pytest.raises(FormatError, match=r"kind 'gaussian-process', got 'tests/nearest'"):
        load_model(path, GaussianProcessModel)


def test_a_kind_is_registered_once():
    with pytest.raises(InputError, match="needs a kind of its own"):
        register_predictor(type("Other", (Nearest,), {}))


def test_text_columns_reach_a_predictor_that_reads_them(table):
    class Finish(Nearest):
        def predict_frame(self, frame):
            bright = (frame["finish"] == "primer").to_numpy()
            return Prediction(mean=bright * 1.0, std=bright * 0.0, inside=bright)

    model = Finish.train(table, name="finish", target="p_norm", inputs=("i_avg",))
    object.__setattr__(model, "inputs", ("finish",))
    frame = pl.DataFrame({"finish": ["bare", "primer"], "i_avg": [1.0, 2.0]})
    assert model.predict(frame).mean.tolist() == [0.0, 1.0]

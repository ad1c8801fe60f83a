"""Forecasts of a view by the paper's chain, held against a world in which everything is known."""

import re
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import polars as pl
import pytest
from scipy.special import ndtr

from exposight.cell import Feature, Part, sensor_preset
from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.models import Prediction, Predictor, Provenance, model_named
from exposight.observing import View
from exposight.planning import WANTED_BRIGHTNESS, Forecast, SensorModels

SENSOR = sensor_preset("comet-pro-ae")
TIMES_MS = (5.0, 10.0, 20.0, 40.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownModel(Predictor):
    """Predicts by a formula, as if it had been trained."""

    formula: object
    spread: float
    known: object

    def predict_frame(self, frame):
        columns = {name: frame[name].to_numpy() for name in self.inputs}
        mean = self.formula(columns)
        inside = np.broadcast_to(self.known(columns), mean.shape)
        return Prediction(mean=mean, std=np.full(len(mean), self.spread), inside=inside)


def known_model(name, formula, std=0.0, known=lambda columns: True):
    like = model_named(name)
    nowhere = Provenance(
        observations="", observations_sha256=None, emulated=False, seed=None, exposight_version=""
    )
    return KnownModel(
        name=name,
        title="",
        target=like.target,
        inputs=like.inputs,
        provenance=nowhere,
        formula=formula,
        spread=std,
        known=known,
    )


@pytest.fixture(scope="module")
def holes():
    """Three holes, 100 mm apart, squarely before the sensor in the plane of its TCP."""
    features = tuple(
        Feature(
            name=f"f{x:g}",
            kind="hole",
            part_from_feature=RigidTransform(translation_mm=np.array([x, 0.0, 0.0])),
            radius_mm=5.0,
        )
        for x in (-100.0, 0.0, 100.0)
    )
    return View.of(Part(name="plate", features=features), SENSOR, SENSOR.camera_from_tcp)


def forecast(quality, exposure, view, times_ms, **settings):
    return SensorModels(quality=quality, exposure=exposure).forecast(view, times_ms, **settings)


def _ms_at(i_avg, x_mm):
    """A surface on which a grey level needs longer, the further right it is."""
    return i_avg * (0.2 + 0.001 * x_mm)


EXPOSURE = known_model("e_k6", lambda c: _ms_at(c["i_avg"], c["x_mm"]))
QUALITY = known_model("q_k4", lambda c: c["i_avg"] / 255.0)


def test_brightness_is_in_proportion_to_the_exposure_time(holes):
    found = forecast(QUALITY, EXPOSURE, holes, TIMES_MS)
    expected = np.array(TIMES_MS) / np.array([[0.1], [0.2], [0.3]])
    np.testing.assert_allclose(found.brightness, np.minimum(expected, 255.0), rtol=1e-12)


def test_the_quality_is_the_models_at_that_brightness(holes):
    found = forecast(QUALITY, EXPOSURE, holes, TIMES_MS)
    np.testing.assert_allclose(found.p_norm, found.brightness / 255.0, rtol=1e-12)


def test_the_wanted_exposure_times_are_the_models(holes):
    found = forecast(QUALITY, EXPOSURE, holes, TIMES_MS)
    expected = WANTED_BRIGHTNESS * np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(found.wanted_ms, np.tile(expected[:, None], 3))
    assert found.features == ("f-100", "f0", "f100")


def test_no_band_of_exposure_times_reaches_below_0(holes):
    unsure = known_model("e_k6", lambda c: _ms_at(c["i_avg"], c["x_mm"]), std=50.0)
    found = forecast(QUALITY, unsure, holes, TIMES_MS)
    assert found.wanted_ms.min() == 0.0
    assert (np.diff(found.wanted_ms, axis=1) > 0.0).all()


def test_without_doubt_about_brightness_the_band_is_the_quality_models(holes):
    quality = known_model("q_k4", lambda c: c["i_avg"] / 255.0, std=0.01)
    found = forecast(quality, EXPOSURE, holes, TIMES_MS)
    width = found.p_norm_high - found.p_norm_low
    expected = np.minimum(found.p_norm + 0.02, 1.0) - found.p_norm + 0.02
    np.testing.assert_allclose(width, expected, rtol=1e-9)


def test_the_chance_is_that_of_the_normal_distribution(holes):
    quality = known_model("q_k4", lambda c: c["i_avg"] / 255.0, std=0.1)
    found = forecast(quality, EXPOSURE, holes, TIMES_MS, need=0.3)
    np.testing.assert_allclose(found.chance, ndtr((found.p_norm - 0.3) / 0.1), rtol=1e-9)


def test_doubt_about_brightness_widens_the_band(holes):
    # To first order q changes by (dq/dt₀)·σ: q = 80·t/t₀/255 falls by q/t₀ for each ms.
    std_ms = 0.05
    doubting = known_model("e_k6", lambda c: _ms_at(c["i_avg"], c["x_mm"]), std=std_ms)
    found = forecast(QUALITY, doubting, holes, (5.0,))
    expected = found.p_norm[:, 0] / found.wanted_ms[:, 1] * std_ms
    width = (found.p_norm_high - found.p_norm_low)[:, 0]
    np.testing.assert_allclose(width / 4.0, expected, rtol=1e-3)


def test_what_a_model_does_not_know_is_named_and_does_not_choose(holes):
    exposure = known_model(
        "e_k6", lambda c: _ms_at(c["i_avg"], c["x_mm"]), known=lambda c: c["x_mm"] < 50.0
    )
    quality = known_model("q_k4", lambda c: 1.0 - np.abs(c["i_avg"] - 100.0) / 255.0, std=0.1)
    found = forecast(quality, exposure, holes, TIMES_MS)
    assert found.knows.tolist() == [True, True, False]
    assert "outside the training data" in found.unknown[2]
    assert "not known: f100: outside the training data" in str(found)
    # 10 and 20 ms give f-100 and f0 100 grey levels; f100 would want more
    assert found.best_exposure_ms() in (10.0, 20.0)
    assert not found.frame.filter(feature="f100")["known"].any()


def test_the_best_exposure_time_serves_most_features(holes):
    found = forecast(QUALITY, EXPOSURE, holes, TIMES_MS)
    peaked = replace(found, chance=np.array([[0.2, 0.9, 0.5, 0.0], [0.1, 0.3, 0.8, 0.0]] * 2)[:3])
    assert isinstance(peaked, Forecast)
    assert peaked.best_exposure_ms() == 10.0
    assert "1 of 3 features" not in peaked.verdict


@pytest.mark.parametrize("times_ms", [(), (0.0, 5.0)])
def test_a_forecast_at_no_time_is_refused(holes, times_ms):
    with pytest.raises(InputError, match="exposure times above 0 ms, got 3 features"):
        forecast(QUALITY, EXPOSURE, holes, times_ms)


def test_a_forecast_of_nothing_is_refused(holes):
    with pytest.raises(InputError, match="at least one visible feature"):
        forecast(QUALITY, EXPOSURE, replace(holes, features=()), TIMES_MS)


def test_the_frame_has_a_row_for_each_feature_and_time(holes):
    quality = known_model("q_k4", lambda c: c["i_avg"] / 255.0, std=0.4)
    found = forecast(quality, EXPOSURE, holes, (5, 40))
    frame = found.frame
    assert frame["feature"].to_list() == ["f-100"] * 2 + ["f0"] * 2 + ["f100"] * 2
    assert frame["exposure_ms"].to_list() == [5.0, 40.0] * 3
    assert frame["p_norm_low"].min() == 0.0
    assert frame["p_norm_high"].max() == 1.0
    np.testing.assert_array_equal(frame["p_norm"].to_numpy(), found.p_norm.ravel())
    assert frame["known"].all()


def test_a_forecast_is_written_and_shown(holes, tmp_path):
    found = forecast(QUALITY, EXPOSURE, holes, TIMES_MS)
    found.write(tmp_path / "forecast.csv")
    assert pl.read_csv(tmp_path / "forecast.csv").height == found.frame.height
    assert str(found).startswith("best exposure time for 3 features: 40 ms, ")
    assert "3 features: 40 ms" in found._repr_html_()


def test_a_view_is_forecast_for_the_features_that_it_sees():
    holes = [
        Feature(
            name=f"f{x:g}",
            kind="hole",
            part_from_feature=RigidTransform(translation_mm=[x, 0.0, 0.0]),
            radius_mm=5.0,
        )
        for x in (0.0, 5000.0)
    ]
    view = View.of(Part(name="p", features=tuple(holes)), SENSOR, SENSOR.camera_from_tcp)
    assert len(view.features) == 2
    assert forecast(QUALITY, EXPOSURE, view, TIMES_MS).features == ("f0",)


@pytest.mark.parametrize(
    ("question", "fact"),
    [
        ({"limits": "nobody"}, "no exposure limits are called 'nobody'"),
        (
            {"limits": 5.0},
            "expected ExposureLimits or the name of some, such as 'zivid-2', got 5.0",
        ),
        ({"confidence": "x"}, "confidence is a chance above 0 and below 1, such as 0.9, got 'x'"),
    ],
)
def test_wrong_wishes_for_a_recommendation_are_named(default_models, view, question, fact):
    forecast = default_models.forecast(view("near"))
    for asked in (forecast.recommend, partial(default_models.recommend, view("near"))):
        with pytest.raises(InputError, match=re.escape(fact)):
            asked(**question)
    assert forecast.recommend("zivid-2").limits.name == "Zivid 2"

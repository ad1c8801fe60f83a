"""Forecasts of a view, held against a world in which everything is known."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from exposight.cell import Feature, Part, sensor_preset
from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.models import Prediction, model_named
from exposight.observing import View, view_features
from exposight.planning import WANTED_I_AVG, Forecast, forecast

SENSOR = sensor_preset("comet-pro-ae")
TIMES_MS = (5.0, 10.0, 20.0, 40.0)


class KnownModel:
    """Predicts by a formula, as if it had been trained."""

    def __init__(self, name, formula, std=0.0):
        self.inputs, self._formula, self._std = model_named(name).inputs, formula, std

    def predict(self, frame):
        mean = self._formula({name: frame[name].to_numpy() for name in self.inputs})
        return Prediction(
            mean=mean, std=np.full(len(mean), self._std), inside=np.ones(len(mean), dtype=bool)
        )


@pytest.fixture(scope="module")
def views():
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
    return view_features(Part(name="plate", features=features), SENSOR, SENSOR.camera_from_tcp)


def _ms_at(i_avg, x_mm):
    """A surface on which a grey level needs longer, the further right it is."""
    return i_avg * (0.2 + 0.001 * x_mm)


EXPOSURE = KnownModel("e_k6", lambda c: _ms_at(c["i_avg"], c["x_mm"]))
QUALITY = KnownModel("q_k4", lambda c: c["i_avg"] / 255.0)


def test_brightness_is_in_proportion_to_the_exposure_time(views):
    found = forecast(QUALITY, EXPOSURE, views, TIMES_MS)
    expected = np.array(TIMES_MS) / np.array([[0.1], [0.2], [0.3]])
    np.testing.assert_allclose(found.i_avg, np.minimum(expected, 255.0), rtol=1e-12)


def test_the_quality_is_the_models_at_that_brightness(views):
    found = forecast(QUALITY, EXPOSURE, views, TIMES_MS)
    np.testing.assert_allclose(found.p_norm, found.i_avg / 255.0, rtol=1e-12)


def test_the_wanted_exposure_times_are_the_models(views):
    found = forecast(QUALITY, EXPOSURE, views, TIMES_MS)
    np.testing.assert_allclose(found.wanted.mean, WANTED_I_AVG * np.array([0.1, 0.2, 0.3]))
    assert found.features == ("f-100", "f0", "f100")


def test_without_doubt_about_brightness_the_band_is_the_quality_models(views):
    quality = KnownModel("q_k4", lambda c: c["i_avg"] / 255.0, std=0.1)
    found = forecast(quality, EXPOSURE, views, TIMES_MS)
    np.testing.assert_allclose(found.p_norm_std, 0.1, rtol=1e-9)


def test_doubt_about_brightness_widens_the_band(views):
    # To first order q changes by (dq/dt₀)·σ: q = 80·t/t₀/255 falls by q/t₀ for each ms.
    std_ms = 0.05
    doubting = KnownModel("e_k6", lambda c: _ms_at(c["i_avg"], c["x_mm"]), std=std_ms)
    found = forecast(QUALITY, doubting, views, (5.0,))
    expected = found.p_norm[:, 0] / found.wanted.mean * std_ms
    np.testing.assert_allclose(found.p_norm_std[:, 0], expected, rtol=1e-3)


def test_the_best_exposure_time_has_the_highest_mean_quality(views):
    found = forecast(QUALITY, EXPOSURE, views, TIMES_MS)
    peaked = replace(found, p_norm=np.array([[0.2, 0.9, 0.5, 0.0], [0.1, 0.3, 0.8, 0.0]] * 2))
    assert isinstance(peaked, Forecast)
    assert peaked.best_exposure_ms() == 20.0


@pytest.mark.parametrize(("n_views", "times_ms"), [(0, TIMES_MS), (3, ())])
def test_a_forecast_of_nothing_is_refused(views, n_views, times_ms):
    with pytest.raises(InputError, match="at least one visible feature and one exposure time"):
        forecast(QUALITY, EXPOSURE, views[:n_views], times_ms)


def test_the_frame_has_a_row_for_each_feature_and_time(views):
    quality = KnownModel("q_k4", lambda c: c["i_avg"] / 255.0, std=0.4)
    found = forecast(quality, EXPOSURE, views, (5, 40))
    frame = found.frame
    assert frame.columns[:4] == ["feature", "exposure_ms", "i_avg", "p_norm"]
    assert frame["feature"].to_list() == ["f-100"] * 2 + ["f0"] * 2 + ["f100"] * 2
    assert frame["exposure_ms"].to_list() == [5.0, 40.0] * 3
    assert frame["p_norm_low"].min() == 0.0
    assert frame["p_norm_high"].max() == 1.0
    np.testing.assert_array_equal(frame["p_norm"].to_numpy(), found.p_norm.ravel())
    assert frame["inside"].all()


def test_a_forecast_is_written_and_shown(views, tmp_path):
    found = forecast(QUALITY, EXPOSURE, views, TIMES_MS)
    found.write(tmp_path / "forecast.csv")
    assert pl.read_csv(tmp_path / "forecast.csv").height == found.frame.height
    assert str(found).startswith("best exposure time for 3 features: 40 ms")
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
    part = Part(name="p", features=tuple(holes))
    view = View(view_features(part, SENSOR, SENSOR.camera_from_tcp))
    assert len(view.features) == 2
    assert forecast(QUALITY, EXPOSURE, view, TIMES_MS).features == ("f0",)

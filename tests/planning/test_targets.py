"""Exposures for another quality than the number of points: here a diameter's error."""

import numpy as np
import polars as pl
import pytest
from tests.models.rings import BLACK, SENSOR, observed

from exposight.cell import Feature, Part
from exposight.errors import InputError, ObservationError
from exposight.geometry import RigidTransform
from exposight.models import save_model, train_response, train_window
from exposight.observing import ObservationTable, View
from exposight.planning import SensorModels

BEST_GREY = 40.0
"""Brightness above black at which diameters are best here."""


def off_mm(grey):
    return 0.02 + 0.05 * np.log(grey / BEST_GREY) ** 2


@pytest.fixture(scope="module")
def table():
    """Errors of either sign; rings that clip are left out, as where no rim is seen."""
    rows = observed()
    grey = rows.array(["i_mean"])[:, 0] - BLACK
    rng = np.random.default_rng(0)
    error = rng.choice([-1.0, 1.0], len(grey)) * (off_mm(grey) + rng.normal(0, 0.003, len(grey)))
    seen = (rows.array(["p_norm"])[:, 0] > 0.5) & (grey < 180.0)
    column = pl.Series("diameter_error_mm", np.where(seen, error, np.nan)).fill_nan(None)
    return ObservationTable.from_frame(rows.frame.with_columns(column))


@pytest.fixture(scope="module")
def models(table, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    quality = train_window(table, sensor=SENSOR)
    response = train_response(table, "diameter_error_mm", model=quality)  # lower is better
    for model in (quality, quality.radiance, response):
        save_model(folder / f"{model.name}.exposight-model", model)
    return folder


@pytest.fixture(scope="module")
def view():
    holes = tuple(
        Feature(
            name=f"f{i}",
            kind="hole",
            part_from_feature=RigidTransform(translation_mm=[x, y, 0.0]),
            radius_mm=5.0,
        )
        for i, (x, y) in enumerate([(0.0, 0.0), (20.0, 10.0), (-15.0, 25.0)])
    )
    pose = SENSOR.camera_from_tcp @ RigidTransform.from_fanuc_wpr((0, 0, 0), 0, -10, 8)
    return View.of(Part(name="p", features=holes), SENSOR, pose, name="new")


def test_the_exposure_for_the_best_diameter_is_not_that_for_most_points(models, view):
    diameter = SensorModels.load(models, target="diameter_error_mm")
    chosen = diameter.recommend(view, need=0.05)
    assert "3 of 3 features will have diameter_error_mm of at most 0.05 mm" in chosen.verdict
    forecast = SensorModels.load(models).forecast(view, chosen.exposures_ms)
    grey = forecast.brightness[:, 0] - BLACK
    assert off_mm(grey).max() < 0.05
    best = diameter.recommend(view)
    assert best.need < 0.05
    assert len(best.exposures_ms) == 1
    assert not best.failing
    (most_points_ms,) = SensorModels.load(models).recommend(view).exposures_ms
    there = SensorModels.load(models).forecast(view, [most_points_ms]).brightness[:, 0] - BLACK
    at_best = SensorModels.load(models).forecast(view, best.exposures_ms).brightness[:, 0] - BLACK
    assert off_mm(at_best).max() < off_mm(there).max()


def test_nothing_is_promised_that_cannot_be_had(models, view):
    chosen = SensorModels.load(models, target="diameter_error_mm").recommend(view, need=0.001)
    assert not chosen.planned
    assert "0 of 3 features" in chosen.verdict or chosen.verdict.startswith("take none")


def test_a_model_of_another_quality_is_not_taken_for_p_norm(models):
    file = models / "quality_diameter_error_mm.exposight-model"
    with pytest.raises(InputError, match=r"expected a model that predicts p_norm, got .*diameter"):
        SensorModels.load(file)
    assert SensorModels.load(models).quality.target == "p_norm"


def test_a_good_diameter_that_is_rarely_measured_is_not_promised(table):
    """Here it is best where it is brightest, and there nine of ten captures do not measure it."""
    quality = train_window(table, sensor=SENSOR)
    grey = table.array(["i_mean"])[:, 0] - BLACK
    often = np.arange(len(grey)) % 10 == 0
    error = np.where((grey < 60.0) | often, 1.0 / grey, np.nan)
    column = pl.Series("diameter_error_mm", error).fill_nan(None)
    rare = ObservationTable.from_frame(table.frame.with_columns(column))
    model = train_response(rare, "diameter_error_mm", model=quality)
    assert np.exp(model.window.span[1]) == pytest.approx(60.0, rel=0.3)
    forecast = model.forecast(table.frame.head(1), np.geomspace(1.0, 1000.0, 60), need=1.0)
    bright = forecast.i_mean()[0] - BLACK
    assert forecast.chance[0][bright > 100.0].max() < 0.1
    assert forecast.chance[0].max() > 0.9


def test_what_is_rarely_measured_at_any_brightness_is_no_target(table):
    quality = train_window(table, sensor=SENSOR)
    rare = pl.when(pl.int_range(pl.len()) % 10 == 0).then(0.01).alias("diameter_error_mm")
    with pytest.raises(ObservationError, match=r"diameter_error_mm is measured in at most \d+ %"):
        train_response(
            ObservationTable.from_frame(table.frame.with_columns(rare)),
            "diameter_error_mm",
            model=quality,
        )


def test_which_is_better_must_be_known(table):
    quality = train_window(table, sensor=SENSOR)
    other = ObservationTable.from_frame(table.frame.with_columns(flatness=pl.col("p_norm")))
    with pytest.raises(InputError, match="say whether higher or lower flatness is better"):
        train_response(other, "flatness", model=quality)
    with pytest.raises(InputError, match="what the quality model itself predicts"):
        train_response(table, "p_norm", model=quality, better="higher")

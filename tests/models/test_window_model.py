"""The radiance and window models: what they find, predict, keep and refuse."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from tests.models.rings import (
    BLACK,
    EXPOSURES_MS,
    HIGH,
    LOG_RATIO,
    LOW,
    ROUGHNESS,
    SENSOR,
    observed,
)

from exposight.errors import InputError, ObservationError
from exposight.geometry import RigidTransform
from exposight.models import (
    WindowModel,
    load_model,
    log_radiance,
    ring_training,
    save_model,
    train_response,
    train_window,
)
from exposight.models.ring_data import black_level_of, ring_data
from exposight.observing import ObservationTable

TIMES = np.geomspace(3.0, 500.0, 40)


@pytest.fixture(scope="module")
def model() -> WindowModel:
    return train_window(observed(), sensor=SENSOR)


@pytest.fixture(scope="module")
def unseen() -> ObservationTable:
    """Other features in other views: more of the same sheet."""
    table = observed(features=12, views=6, seed=1, places="new-{}", names="f{}")
    later = table.frame["feature"].is_in([f"f{i}" for i in range(8, 12)])
    return table.where(later)


def rings_of(table: ObservationTable) -> pl.DataFrame:
    return table.frame.unique(["feature", "view"], maintain_order=True)


def rmse(model: WindowModel, table: ObservationTable) -> float:
    error = model.predict(table).mean - table.array(["p_norm"])[:, 0]
    return float(np.sqrt(np.mean(error**2)))


def test_rings_that_were_learnt_from_are_known_again(model, unseen) -> None:
    learnt = rings_of(observed())
    assert model.has_learnt(learnt).mean() > 0.9  # others were never bright enough, or clipped
    assert not model.has_learnt(unseen.frame).any()
    moved = learnt.with_columns(pl.col("x_mm") + 0.01)
    assert not model.has_learnt(moved).any()
    assert not model.has_learnt(learnt.with_columns(feature="other " + pl.col("feature"))).any()


def test_the_sensors_limits_and_the_surfaces_lobe_are_found(model: WindowModel) -> None:
    low, high = model.limits
    assert low == pytest.approx(LOW, rel=0.05)
    assert high == pytest.approx(HIGH, rel=0.05)
    assert model.radiance.black_level == pytest.approx(BLACK, abs=0.1)
    formula = model.radiance.learnt.formula
    assert formula.log_ratio == pytest.approx(LOG_RATIO, abs=0.4)
    assert formula.roughness == pytest.approx(ROUGHNESS, abs=0.04)


@pytest.mark.parametrize(("mean", "worst"), [("projector", 0.03), ("camera", 0.06), ("none", 0.15)])
def test_unseen_features_are_predicted_with_honest_bands(
    unseen: ObservationTable, mean: str, worst: float
) -> None:
    model = train_window(observed(), sensor=SENSOR, mean=mean)  # type: ignore[arg-type]
    assert rmse(model, unseen) < worst
    prediction, p = model.predict(unseen), unseen.array(["p_norm"])[:, 0]
    assert np.mean((prediction.low <= p) & (p <= prediction.high)) > 0.9


def test_exposure_times_for_a_brightness_are_positive_and_right(
    model: WindowModel, unseen: ObservationTable
) -> None:
    rows = model.radiance.rows(unseen)
    prediction, times = model.radiance.predict(rows), rows.array(["exposure_ms"])[:, 0]
    assert np.median(np.abs(prediction.mean / times - 1.0)) < 0.03
    assert (prediction.low > 0.0).all()
    assert (prediction.low < prediction.mean).all()
    assert (prediction.mean < prediction.high).all()


def test_brightness_that_clips_is_not_relied_on(model: WindowModel) -> None:
    table = observed(views=1, seed=5, places="new-{}")
    clips = table.array(["stack_clipped_share"])[:, 0] > 0.01
    prediction = model.radiance.predict(table)
    assert clips.any()
    assert not prediction.inside[clips].any()
    reasons = np.array(model.radiance.unknown(table))
    assert all("clips" in reason for reason in reasons[clips])


def test_no_exposure_time_gives_less_than_the_black_level(model: WindowModel) -> None:
    row = observed(views=1, features=1).frame[:1].with_columns(i_mean=pl.lit(5.0))
    with pytest.raises(ObservationError, match="without light"):
        model.radiance.predict(row)


def test_a_black_level_is_found_only_from_sweeps() -> None:
    data = ring_data(observed(exposures_ms=(20.0,)))
    assert not data.black_level_known
    assert black_level_of(np.arange(5), np.full(5, 30.0), np.full(5, 10.0)) is None
    assert ring_data(observed()).black_level == pytest.approx(BLACK, abs=0.1)


def test_rings_that_always_clip_are_known_to_be_bright() -> None:
    table = observed()
    bright = (table.frame["feature"] == "f3") & (table.frame["exposure_ms"] < 160.0)
    model = train_window(table.where(~bright), sensor=SENSOR)  # f3 clips at what is left
    without = train_window(table.where(table.frame["feature"] != "f3"), sensor=SENSOR)
    rings = rings_of(table).filter(pl.col("feature") == "f3")
    shown = model.forecast(rings, TIMES)
    truth = ring_data(table.where(table.frame["feature"] == "f3"))
    assert np.abs(shown.mean - truth.log_radiance).max() < 0.15
    assert (shown.std < without.forecast(rings, TIMES).std + 1e-9).mean() > 0.5


def test_a_forecasts_chance_is_that_of_its_joint_draws(
    model: WindowModel, unseen: ObservationTable
) -> None:
    forecast = model.forecast(rings_of(unseen), TIMES)
    windows = forecast.draw_windows(4000, np.random.default_rng(1))
    inside = (windows[..., 0, None] <= TIMES) & (windows[..., 1, None] >= TIMES)
    np.testing.assert_allclose(inside.mean(axis=0), forecast.chance, atol=0.04)
    # what is uncertain of a view's light is shared by its rings
    assert np.linalg.eigvalsh(forecast.covariance).min() > -1e-9


def test_quantiles_are_ordered_and_hold_the_mean(
    model: WindowModel, unseen: ObservationTable
) -> None:
    forecast = model.forecast(rings_of(unseen), TIMES)
    levels = [forecast.quantile(level) for level in (0.02, 0.25, 0.5, 0.75, 0.98)]
    assert all((a <= b + 1e-9).all() for a, b in pairwise(levels))
    assert (forecast.low >= 0.0).all()
    assert (forecast.low - 0.02 <= forecast.p_norm).all()
    assert (forecast.p_norm <= forecast.high + 0.02).all()


def test_the_windows_ends_are_where_quality_passes_what_is_needed(
    model: WindowModel, unseen: ObservationTable
) -> None:
    forecast = model.forecast(rings_of(unseen), TIMES)
    low, high = forecast.window_ms()
    for i in range(3):
        at_ends = forecast.at([low[i], high[i]]).quantile(0.5)[i]
        np.testing.assert_allclose(at_ends, 0.75, atol=0.02)


def test_a_forecast_for_one_brightness_agrees_with_the_exposure_model(
    model: WindowModel, unseen: ObservationTable
) -> None:
    rings = rings_of(unseen)
    forecast = model.forecast(rings, TIMES)
    wanted = model.radiance.predict(rings.with_columns(i_mean=pl.lit(80.0)))
    np.testing.assert_allclose(forecast.exposure_ms(80.0)[:, 1], wanted.mean, rtol=1e-9)
    with pytest.raises(InputError, match="no exposure time"):
        forecast.exposure_ms(5.0)


# -- levels of knowledge ------------------------------------------------------------------------


def at(table: ObservationTable, exposure_ms: float) -> ObservationTable:
    return table.where(table.frame["exposure_ms"] == exposure_ms)


def forecast_error(
    model: WindowModel, table: ObservationTable, trial: ObservationTable | None
) -> float:
    rings = rings_of(table)
    forecast = model.forecast(rings, EXPOSURES_MS, trial=trial)
    errors = [
        forecast.p_norm[i]
        - table.frame.filter((pl.col("feature") == feature) & (pl.col("view") == view))
        .sort("exposure_ms")["p_norm"]
        .to_numpy()
        for i, (feature, view) in enumerate(rings.select("feature", "view").iter_rows())
        if forecast.knows[i]
    ]
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.parametrize("exposure_ms", EXPOSURES_MS)
def test_a_trial_capture_never_makes_a_forecast_worse(
    model: WindowModel, unseen: ObservationTable, exposure_ms: float
) -> None:
    pose_only = forecast_error(model, unseen, None)
    assert forecast_error(model, unseen, at(unseen, exposure_ms)) < pose_only + 0.003


def test_one_image_without_its_stack_refines_too(
    model: WindowModel, unseen: ObservationTable
) -> None:
    stack = [name for name in unseen.frame.columns if name[:6] in {"i_max_", "i_mod_"}]
    bare = ObservationTable.from_frame(at(unseen, 20.0).frame.drop(stack))
    rings = rings_of(unseen)
    before = model.forecast(rings, TIMES)
    after = model.forecast(rings, TIMES, trial=bare)
    assert (after.std < before.std + 1e-12).all()
    assert set(after.source) == {"pose and image"}


def test_another_surface_is_noticed_and_measured_by_the_trial(model: WindowModel) -> None:
    other = observed(views=3, seed=5, log_ratio=-2.0, level=12.5, places="new-{}")
    forecast = model.forecast(rings_of(other), TIMES, trial=at(other, 20.0))
    assert "not the surface" in forecast.remarks[0]
    assert set(forecast.source) == {"capture"}
    assert forecast_error(model, other, at(other, 20.0)) < 0.05
    blind = forecast_error(model, other, None)
    assert blind > 0.1


def test_another_finish_by_name_is_not_relied_on_without_a_trial(model: WindowModel) -> None:
    other = observed(views=2, seed=5, finish="paint", places="new-{}")
    forecast = model.forecast(rings_of(other), TIMES)
    assert not forecast.knows.any()
    assert "paint" in forecast.unknown[0]
    assert model.remarks(other.frame)
    assert model.forecast(rings_of(other), TIMES, trial=at(other, 20.0)).knows.all()


def test_a_trial_from_another_pose_is_refused(model: WindowModel) -> None:
    table = observed(views=2, seed=5, places="new-{}")
    moved = ObservationTable.from_frame(at(table, 20.0).frame.with_columns(pl.col("x_mm") + 10.0))
    with pytest.raises(InputError, match=r"10\.0 mm away"):
        model.forecast(rings_of(table), TIMES, trial=moved)


def test_features_far_from_anything_learnt_are_abstained_from(model: WindowModel) -> None:
    table = observed(views=1, seed=5, places="new-{}")
    tilted = rings_of(table).with_columns(pl.col("w_deg") + 65.0)
    forecast = model.forecast(tilted, TIMES)
    assert not forecast.knows.any()
    assert "would tell" in forecast.unknown[0]
    assert not model.predict(tilted.with_columns(exposure_ms=pl.lit(20.0))).inside.any()


def test_any_quality_of_a_ring_can_be_a_target(tmp_path: Path) -> None:
    """Here a noise that falls with brightness and grows where rings clip."""

    def with_noise(table: ObservationTable) -> ObservationTable:
        level = (ring_data(table).log_radiance, ring_data(table).rings.keys)
        radiance = dict(zip(level[1], level[0], strict=True))
        keys = table.frame.select("feature", "view").iter_rows()
        log_brightness = np.array([radiance[key] for key in keys])
        log_brightness += np.log(table.array(["exposure_ms"])[:, 0])
        rng = np.random.default_rng(3)
        noise = 2.0 * np.exp(-log_brightness) + 0.05 * np.exp(log_brightness - np.log(100.0))
        noise += rng.normal(0.0, 0.005, len(noise))
        return ObservationTable.from_frame(table.frame.with_columns(noise_mm=pl.Series(noise)))

    table, new = with_noise(observed()), with_noise(observed(views=4, seed=8, places="new-{}"))
    model = train_response(
        table, "noise_mm", model=train_window(table, sensor=SENSOR), better="lower"
    )
    noise = new.array(["noise_mm"])[:, 0]
    moderate = noise < 0.4
    prediction = model.predict(new)
    assert np.sqrt(np.mean((prediction.mean - noise)[moderate] ** 2)) < 0.03
    inside = (prediction.low <= noise) & (noise <= prediction.high)
    assert inside[moderate].mean() > 0.9
    with pytest.raises(InputError, match="which noise_mm is needed"):
        model.forecast(rings_of(new), TIMES)
    forecast = model.forecast(rings_of(new), TIMES, need=0.1)
    good = forecast.quality < 0.08
    assert forecast.chance[good].min() > 0.9
    assert forecast.chance[forecast.quality > 0.12].max() < 0.2
    save_model(tmp_path / "noise.exposight-model", model)
    again = load_model(tmp_path / "noise.exposight-model")
    np.testing.assert_array_equal(again.predict(new).mean, prediction.mean)
    with pytest.raises(ObservationError, match="no numeric column 'form_mm'"):
        train_response(table, "form_mm", model=model, better="lower")


# -- learning on, transfer ----------------------------------------------------------------------


def test_more_captures_are_learnt_without_a_new_fit(
    model: WindowModel, unseen: ObservationTable
) -> None:
    views = unseen.frame["view"].unique(maintain_order=True).to_list()
    some = unseen.where(unseen.frame["view"].is_in(views[:3]))
    rest = unseen.where(unseen.frame["view"].is_in(views[3:]))
    wiser = model.with_observations(some)
    before = model.forecast(rings_of(rest), TIMES)
    after = wiser.forecast(rings_of(rest), TIMES)
    assert (after.std < before.std).all()
    assert rmse(wiser, rest) < rmse(model, rest) + 0.002
    assert wiser.limits == model.limits


def test_few_captures_of_another_finish_suffice_with_the_sensors_limits(
    model: WindowModel,
) -> None:
    whole = observed(views=10, seed=9, log_ratio=0.5, level=12.0, finish="primer")
    few = at(whole.where(whole.frame["view"].is_in(["v0", "v1", "v2"])), 20.0)
    rest = whole.where(whole.frame["view"].is_in([f"v{i}" for i in range(3, 10)]))
    taught = train_window(few, start_from=model)
    assert taught.sensor == SENSOR
    assert rmse(taught, rest) < 0.04
    assert taught.limits[1] == pytest.approx(model.limits[1], rel=0.05)


def test_another_sensor_keeps_the_surface_and_learns_its_limits(model: WindowModel) -> None:
    assert SENSOR.projector is not None
    moved = replace(
        SENSOR.projector,
        camera_from_projector=RigidTransform.from_fanuc_wpr((150.0, 60.0, 0.0), 0.0, -14.0, 0.0),
    )
    other = replace(SENSOR, name="another", projector=moved)
    whole = observed(views=10, seed=9, sensor=other, low=12.0, level=10.5)
    few = whole.where(whole.frame["view"].is_in(["v0", "v1"]))
    rest = whole.where(whole.frame["view"].is_in([f"v{i}" for i in range(2, 10)]))
    taught = train_window(few, sensor=other, start_from=model)
    assert taught.limits[0] == pytest.approx(12.0, rel=0.07)
    lobe = taught.radiance.learnt.formula.log_ratio
    assert lobe == pytest.approx(model.radiance.learnt.formula.log_ratio, abs=0.5)
    assert rmse(taught, rest) < 0.04


def test_a_new_view_with_the_name_of_a_learnt_one_is_a_new_view(model: WindowModel) -> None:
    other = rings_of(observed(views=1, seed=11, places="v{}"))
    named = model.forecast(other, TIMES)
    unnamed = model.forecast(other.with_columns(view=pl.lit("not learnt")), TIMES)
    np.testing.assert_allclose(named.std, unnamed.std)
    np.testing.assert_allclose(named.mean, unnamed.mean)


def test_a_model_file_gives_the_same_predictions(
    model: WindowModel, unseen: ObservationTable, tmp_path: Path
) -> None:
    for number, each in enumerate((model, model.radiance)):
        path = tmp_path / f"{number}.exposight-model"
        save_model(path, each)
        again = load_model(path)
        rows = model.radiance.rows(unseen)
        np.testing.assert_array_equal(again.predict(rows).mean, each.predict(rows).mean)
        assert again.hyperparameters() == each.hyperparameters()
        assert again.sensor == SENSOR


# -- bad input ----------------------------------------------------------------------------------


def changed(table: ObservationTable, **columns: pl.Expr) -> ObservationTable:
    return ObservationTable.from_frame(table.frame.with_columns(**columns))


def test_too_few_rings_are_refused_and_few_features_widen_the_bands(model: WindowModel) -> None:
    with pytest.raises(ObservationError, match="too little"):
        train_window(observed(views=1, features=2), sensor=SENSOR)
    two = train_window(observed(features=2), sensor=SENSOR)
    assert any("2 features only" in note for note in two.notes)
    assert two.radiance.learnt.widening[0] > 2.0 > model.radiance.learnt.widening[0]


def test_one_exposure_per_view_leaves_the_black_level_unknown_and_says_so() -> None:
    model = train_window(observed(exposures_ms=(20.0,)), sensor=SENSOR)
    assert any("black level is not known" in note for note in model.notes)


def test_tables_without_modulation_are_learnt_from() -> None:
    table = observed()
    gone = [name for name in table.frame.columns if name.startswith("i_mod_")]
    model = train_window(ObservationTable.from_frame(table.frame.drop(gone)), sensor=SENSOR)
    assert model.limits[1] == pytest.approx(HIGH, rel=0.05)
    assert rmse(model, table) < 0.05


def test_one_image_alone_is_said_to_scatter() -> None:
    table = observed()
    gone = [name for name in table.frame.columns if name.startswith(("i_m", "stack"))]
    model = train_window(
        ObservationTable.from_frame(table.frame.drop([n for n in gone if n != "i_median"])),
        sensor=SENSOR,
    )
    assert model.radiance.brightness == "i_avg"
    assert any("i_avg" in note for note in model.notes)


def test_captures_that_contradict_themselves_are_refused() -> None:
    twice = ObservationTable.concat([observed(), observed(level=12.5)])
    with pytest.raises(ObservationError, match="contradict themselves"):
        train_window(twice, sensor=SENSOR)


def test_new_captures_of_another_surface_are_not_learnt(model: WindowModel) -> None:
    other = observed(views=2, seed=5, level=12.5, places="new-{}")
    with pytest.raises(ObservationError, match="not the surface"):
        model.with_observations(other)


@pytest.mark.parametrize(
    ("column", "value"), [("exposure_ms", 0.0), ("exposure_ms", -3.0), ("radius_mm", -5.0)]
)
def test_values_that_cannot_be_are_refused(model: WindowModel, column: str, value: float) -> None:
    frame = observed(views=1).frame.with_columns(pl.lit(value).alias(column))
    with pytest.raises(ObservationError, match=column):
        model.predict(frame)


def test_a_sensor_with_another_tcp_is_refused() -> None:
    moved = changed(observed(), tcp=pl.lit("0 0 500 0 0 0"))
    with pytest.raises(ObservationError, match="TCP frame at '0 0 500"):
        train_window(moved, sensor=SENSOR)


def test_nothing_is_kept_of_another_sensor_and_another_finish(model: WindowModel) -> None:
    other = observed(sensor=replace(SENSOR, name="another"), finish="primer")
    with pytest.raises(InputError, match="nothing to keep"):
        train_window(other, sensor=replace(SENSOR, name="another"), start_from=model)


def test_a_need_within_the_scatter_of_the_best_is_neither_sure_nor_hopeless(
    model: WindowModel, unseen: ObservationTable
) -> None:
    forecast = model.forecast(rings_of(unseen), TIMES)
    best = float(forecast.points.best.mean())
    assert 0.2 < np.median(forecast.chance_of(best).max(axis=1)) < 0.8


def test_two_campaigns_whose_views_share_names_are_refused() -> None:
    both = ObservationTable.concat([observed(), observed(seed=4)])
    with pytest.raises(ObservationError, match="several poses in view 'v0'"):
        train_window(both, sensor=SENSOR)


def test_a_mean_that_needs_what_is_not_known_is_refused() -> None:
    nameless = changed(observed(), sensor=pl.lit(""))
    with pytest.raises(InputError, match="needs a sensor"):
        train_window(nameless, mean="projector")
    with pytest.raises(InputError, match="projector's pose"):
        train_window(nameless, mean="projector", sensor=replace(SENSOR, projector=None))
    assert train_window(nameless).radiance.learnt.formula.kind == "none"


@pytest.mark.parametrize("column", ["finish", "sensor", "tcp"])
def test_mixed_tables_are_refused(column: str) -> None:
    table = changed(observed(), tcp=pl.lit("0 0 600 0 0 0"))
    other = changed(observed(places="w{}"), **{column: pl.lit("another"), "i_std": pl.lit(1.0)})
    with pytest.raises(ObservationError, match=f"more than one {column}"):
        train_window(ObservationTable.concat([table, other]))


def test_rows_of_another_sensor_are_refused(model: WindowModel) -> None:
    other = changed(observed(views=1), sensor=pl.lit("another"))
    with pytest.raises(ObservationError, match="another"):
        model.predict(other)
    with pytest.raises(ObservationError, match="another"):
        train_window(other, sensor=SENSOR)


@pytest.mark.parametrize(
    "columns",
    [
        {"z_mm": pl.col("z_mm") + 650.0},
        {name: pl.col(name) / 1000.0 for name in ("x_mm", "y_mm", "z_mm")},
        {"w_deg": pl.col("w_deg") + 180.0},
    ],
    ids=["camera frame", "metres", "normals outward"],
)
def test_poses_in_another_unit_or_frame_are_refused(columns: dict[str, pl.Expr]) -> None:
    table = with_incidence(observed())
    with pytest.raises(ObservationError, match="TCP frame"):
        train_window(changed(table, **columns), sensor=SENSOR)


def with_incidence(table: ObservationTable) -> ObservationTable:
    """Record the angle between the camera's ray and the normal."""
    x, y, z, w, p = table.array(["x_mm", "y_mm", "z_mm", "w_deg", "p_deg"]).T
    w, p = np.radians(w), np.radians(p)
    into = np.stack([np.sin(p) * np.cos(w), -np.sin(w), np.cos(p) * np.cos(w)], axis=1)
    ray = np.stack([x, y, z + 600.0], axis=1)
    cosine = np.sum(ray * into, axis=1) / np.linalg.norm(ray, axis=1)
    angle = np.degrees(np.arccos(cosine))
    return ObservationTable.from_frame(table.frame.with_columns(incidence_deg=pl.Series(angle)))


def test_a_finish_that_the_formula_cannot_follow_is_said() -> None:
    table = observed()
    rng = np.random.default_rng(0)
    factor = {f"f{i}": f for i, f in enumerate(np.exp(rng.normal(0.0, 0.5, 8)))}
    scale = pl.col("feature").replace_strict(factor)
    times = changed(table, exposure_ms=pl.col("exposure_ms") / scale)
    erratic = times.where(times.frame["exposure_ms"] > 1.0)
    model = train_window(erratic, sensor=SENSOR)
    assert any("does not follow this finish" in note for note in model.notes)


def test_misaligned_views_lower_the_best_quality_that_is_forecast(
    unseen: ObservationTable,
) -> None:
    model = train_window(observed(best=0.9), sensor=SENSOR)
    forecast = model.forecast(rings_of(unseen), TIMES)
    assert forecast.p_norm.max() == pytest.approx(0.9, abs=0.02)
    assert forecast.at(TIMES, need=0.95).chance.max() < 0.05


def test_rows_of_merged_captures_are_not_learnt_from() -> None:
    table = observed()
    source = pl.when(pl.col("view") == pl.first("view")).then(pl.lit("merged"))
    merged = ObservationTable(
        frame=table.frame.with_columns(brightness_source=source.otherwise("brightness_source"))
    )
    with pytest.raises(ObservationError, match="merged captures"):
        train_window(merged, sensor=SENSOR)


def test_a_sphere_is_no_flat_ring_and_its_forecast_is_not_relied_on(
    unseen: ObservationTable,
) -> None:
    table = observed()
    model = train_window(table, sensor=SENSOR)
    kind = pl.when(pl.col("feature") == "f1").then(pl.lit("sphere")).otherwise(pl.lit("hole"))
    rings = rings_of(unseen)
    forecast = model.forecast(rings.with_columns(kind=kind), TIMES)
    plain = model.forecast(rings, TIMES)
    spheres = np.array([name == "f1" for name in forecast.features])
    assert all("curved" in reason for reason in np.array(forecast.unknown)[spheres])
    assert (forecast.chance[spheres].max(axis=1) < 0.9).all()
    assert np.allclose(forecast.chance[~spheres], plain.chance[~spheres])
    trained = train_window(
        ObservationTable(frame=table.frame.with_columns(kind=kind)), sensor=SENSOR
    )
    assert "f1" not in trained.features


def test_of_many_rings_some_of_each_feature_and_view_are_learnt_from(monkeypatch, unseen) -> None:
    monkeypatch.setattr(ring_training, "MOST_RINGS", 60)
    monkeypatch.setattr(log_radiance, "SEARCHED_RINGS", 40)
    seen: list[tuple[str, int, int]] = []
    few = train_window(observed(), sensor=SENSOR, progress=lambda *step: seen.append(step))
    assert len(few.radiance.learnt.process.y) == 60
    assert few.features == tuple(f"f{i}" for i in range(8))
    assert set(few.radiance.learnt.views) == {f"v{i}" for i in range(12)}
    assert few.limits == pytest.approx((LOW, HIGH - BLACK), rel=0.1)
    assert rmse(few, unseen) < 0.06
    assert [done for _, done, _ in seen] == list(range(1, len(seen) + 1))


def test_rings_are_thinned_alike_each_time_measured_ones_first() -> None:
    data = ring_data(observed())
    one, other = data.thinned(50), data.thinned(50)
    assert one.rings.keys == other.rings.keys
    assert (one.limit == 0).all()
    assert data.thinned(len(data)) is data


def test_progress_of_predictions_counts_rings(model) -> None:
    seen: list[tuple[str, int, int]] = []
    frame = rings_of(observed())
    model.predict(frame, progress=lambda *step: seen.append(step))
    assert seen[-1] == ("predicting", frame.height, frame.height)

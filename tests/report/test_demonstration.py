"""The demonstration on the simulated cell, small: three views, two pairs of models; its page."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import CampaignFolder
from exposight.errors import InputError
from exposight.models import load_model, model_named
from exposight.observing import read_observations
from exposight.plans import plan_preset
from exposight.report import DemonstrationSettings, run_demonstration
from exposight.report.demonstration import door_mesh
from exposight.twin.part import DOOR

_SMALL = plan_preset("small")
SETTINGS = DemonstrationSettings(
    compared=(model_named("q_k4"), model_named("e_k6")),
    plan=replace(
        _SMALL,
        planes=tuple(
            replace(
                plane,
                x_mm=plane.x_mm[:1],
                y_mm=plane.y_mm[:1],
                exposures_ms=plane.exposures_ms[1::2],
            )
            for plane in _SMALL.planes
        ),
    ),
    restarts=1,
    workers=1,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def result(folder):
    return run_demonstration(folder, SETTINGS)


def test_the_campaign_is_the_plans(result, folder):
    assert (result.summary.views, result.summary.captures) == (3, 12)
    assert len(CampaignFolder(folder / "campaign")) == 12


def test_test_features_never_train(result):
    assert {name for name in result.table.names("feature") if name.endswith("_test")} == (
        SETTINGS.unseen
    )
    assert SETTINGS.unseen <= result.unseen
    for own in result.results:
        assert set(own.evaluation.table.names("feature")) <= result.unseen
        assert not set(own.training.table.names("feature")) & result.unseen


def test_the_new_view_was_not_in_the_campaign(result):
    assert set(result.table.names("view")).isdisjoint(
        capture.view for capture in result.view.captures
    )


def test_what_was_recommended_was_taken_and_nothing_beside_but_the_best_single_exposure(result):
    view, promise = result.view, result.content["promise"]
    said = promise.recommended
    assert said.exposures
    assert {*view.exposures_ms} == {*said.exposures_ms, promise.single_ms}
    assert view.forecast.quality == "quality"
    assert view.forecast.choice.best_exposure_ms() == promise.single_ms
    assert tuple(each.exposure_ms for each in view.captures) == view.exposures_ms
    assert view.forecast.taken.exposures_ms == view.exposures_ms


def test_promised_and_achieved_are_those_of_the_captures(result):
    view, promise = result.view, result.content["promise"]
    times = [view.exposures_ms.index(each) for each in promise.recommended.exposures_ms]
    best = dict(zip(view.features, view.p_norm[:, times].max(axis=1), strict=True))
    assert promise.achieved == pytest.approx(best)
    assert promise.n_achieved == sum(each >= 0.75 for each in best.values())
    assert {each.feature for each in promise.recommended.features} == {*view.features}
    assert "pocket_2" in promise.failing  # partly out of frame


def test_the_new_view_is_of_whole_frames(result):
    assert all(capture.cloud.organised for capture in result.view.captures)


def test_what_was_measured_is_in_the_order_of_the_features(result):
    view = result.view
    assert view.p_norm.shape == view.i_avg.shape == (len(view.features), len(view.captures))
    assert view.forecast.taken.features == view.features
    for own, i_avg in zip(view.views, view.i_avg[:, -1], strict=True):
        grey = view.captures[-1].image[own.rows, own.columns]
        assert i_avg == pytest.approx(grey.mean())


def test_longer_exposure_is_brighter(result):
    assert (np.diff(result.view.i_avg, axis=1) > 0).all()


def test_what_was_found_is_on_disk(result, folder):
    table = read_observations(folder / "observations.csv")
    assert table.frame.equals(result.table.frame)
    kept = [own for own in result.results if own.model.kind]
    assert [own.name for own in kept] == ["quality", "exposure", "q_k4", "e_k6"]
    for own in kept:
        name = own.name
        model = load_model(folder / "models" / f"{name}.exposight-model")
        again = model.predict(own.evaluation.table)
        np.testing.assert_allclose(again.mean, own.evaluation.prediction.mean, rtol=1e-6)


def test_a_second_run_keeps_what_was_captured_and_finds_the_same(result, folder):
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.npz")}
    again = run_demonstration(folder, SETTINGS)
    assert before == {path: path.stat().st_mtime_ns for path in folder.rglob("*.npz")}
    np.testing.assert_array_equal(
        again.view.forecast.taken.p_norm, result.view.forecast.taken.p_norm
    )
    np.testing.assert_array_equal(again.view.p_norm, result.view.p_norm)


def test_another_seed_does_not_mix_into_the_same_campaign(result, folder):
    with pytest.raises(InputError, match=r"another demonstration, or one of another seed"):
        run_demonstration(folder, replace(SETTINGS, seed=2))


def test_both_pairs_forecast_the_new_view_and_no_band_is_below_0(result):
    default, paper = result.view.forecasts
    assert (default.quality, default.exposure) == ("quality", "exposure")
    assert (paper.quality, paper.exposure) == ("q_k4", "e_k6")
    for each in (default, paper):
        assert each.choice.exposures_ms == default.choice.exposures_ms
        assert each.taken.wanted_ms.min() >= 0.0
        assert (each.taken.p_norm_low <= each.taken.p_norm_high).all()


def test_the_page_says_first_what_was_chosen_and_tells_limits(result):
    page = result.html()
    cards = page[page.index('<div class="cards">') :]
    for exposure_ms in result.content["promise"].recommended.exposures_ms:
        assert f"{exposure_ms:g}" in cards[: cards.index("</p>")]
    assert "limit of modulation = " in " ".join(page.split())
    assert "median relative error" in page


def test_models_that_cannot_forecast_are_refused():
    with pytest.raises(InputError, match="a quality model and an exposure-time model, got q_k1"):
        DemonstrationSettings(compared=(model_named("q_k1"),))


def test_a_plan_without_unseen_features_is_refused():
    with pytest.raises(InputError, match="features whose names end in '_test'"):
        DemonstrationSettings(plan=plan_preset("x"))


def test_the_drawn_door_has_its_size_and_its_holes():
    mesh = door_mesh()
    low, high = mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    np.testing.assert_allclose(low, [-500, -350], atol=1.0)  # the sheet's rounded edge
    np.testing.assert_allclose(high, [500, 350], atol=1.0)
    centres = mesh.vertices[mesh.faces].mean(axis=1)[:, :2]
    for hole in DOOR.holes:
        gap = np.hypot(*(centres - [hole.x_mm, hole.y_mm]).T).min()
        assert gap > 0.7 * hole.radius_mm


def test_the_page_says_whose_numbers_these_are_and_how_to_repeat_them(result):
    page = result.html()
    assert "The numbers are the simulated cell’s" in page
    assert "exposight demo --quick --seed 1" in page
    assert f"{result.view.exposures_ms[0]:.3g}" in page

"""The example on the recorded skull, small: two models, few features, seven exposures."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from exposight.cell import CampaignFolder
from exposight.models import load_model, model_named
from exposight.observing import read_observations

EXPOSURES_MS = tuple(round(10.0 * 10.0 ** (step / 4), 3) for step in range(-3, 4))
MODELS = (model_named("q_k1"), model_named("e_k4"))

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(Path(__file__).parents[2] / "examples" / "05_skull.py"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("skull")


@pytest.fixture(scope="module")
def run(example, real_data, folder):
    return lambda: example["skull_report"](
        real_data / "skull", folder, features=24, exposures_ms=EXPOSURES_MS, models=MODELS,
        restarts=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def report(run):
    return run()


def test_every_feature_is_observed_at_every_exposure(report):
    assert len(report.table.measured()) == 24 * 7
    emulated = report.table.frame.filter(report.table.frame["emulated"])
    assert 10.0 not in emulated["exposure_ms"]
    assert emulated.height == 24 * 6


def test_features_lie_apart_on_smooth_surface_that_faces_the_camera(report):
    centres = np.array([pose.translation_mm for pose in report.view.tcp_from_feature])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2) + 1e9 * np.eye(len(centres))
    assert apart.min() >= 3.0
    assert all(view.pose["incidence_deg"] <= 50.0 for view in report.view.views)


def test_quality_rises_and_falls_with_exposure(report):
    dark, *_, bright = report.summary.p_norm.mean(axis=0)
    assert dark < 0.5
    assert report.summary.p_norm.mean(axis=0)[3] > 0.9
    assert bright < 0.7


def test_position_predicts_the_exposure_time_of_unseen_features(report):
    assert len(report.unseen) == 12
    assert report.results[1].evaluation.score.r2_percent > 60


def test_what_was_measured_and_learnt_is_on_disk_and_stays(report, run, folder):
    assert read_observations(folder / "observations.csv").frame.equals(report.table.frame)
    evaluation = report.results[1].evaluation
    again = load_model(folder / "e_k4.exposight-model").predict(evaluation.table)
    np.testing.assert_array_equal(again.mean, evaluation.prediction.mean)
    before = {path: path.stat().st_mtime_ns for path in (folder / "campaign").rglob("*.npz")}
    run()
    assert before == {
        path: path.stat().st_mtime_ns for path in (folder / "campaign").rglob("*.npz")
    }
    assert len(CampaignFolder(folder / "campaign")) == 7


def test_the_page_says_what_is_emulated(report):
    page = report.html()
    assert "Exposure times are emulated" in page
    assert "nominal 10" in page

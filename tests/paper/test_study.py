"""The whole study on a cell on paper: its records, repetition, interruption, bad input."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from exposight.errors import FeatureError, FileError, InputError
from exposight.models import Prediction, Predictor, Provenance, model_named
from exposight.observing import ObservationTable
from exposight.paper import StudyResult, StudySettings, add_to_study, run_study, table_files

SCRIPT = """
import sys
from pathlib import Path
from exposight.paper import StudySettings, run_study

if __name__ == "__main__":
    settings = StudySettings(quick=True, workers=1, campaigns=Path(sys.argv[1]))
    run_study(Path(sys.argv[2]), settings)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def settings(campaigns: Path) -> StudySettings:
    return StudySettings(quick=True, workers=1, campaigns=campaigns)


@pytest.fixture(scope="module")
def result(folder: Path, settings: StudySettings) -> StudyResult:
    return run_study(folder, settings)


def test_all_variants_are_there(result: StudyResult) -> None:
    assert [own.variant.name for own in result.variants[:5]] == [
        "q_k1",
        "q_k2",
        "q_k3",
        "q_k4",
        "q_k6",
    ]
    assert len(result.variants) == 21


def test_all_datasets_are_there(result: StudyResult) -> None:
    assert len(result.datasets) == 15


def test_all_tables_have_lines(result: StudyResult) -> None:
    assert set(result.tables.scores["table"]) == {2, 3, 4, 5, 6}


def test_scores_are_those_of_the_lines_rows(result: StudyResult) -> None:
    score = result.variant("q_k4").score("test")
    assert score.score.n == len(result.dataset("X_test").table)


def test_the_split_by_view_judges_a_model_that_has_not_seen_the_view(result: StudyResult) -> None:
    score = result.variant("q_k4").score("validation_by_view")
    unseen = set(score.result.table.names("view"))
    assert not unseen & set(result.dataset("X").train_by_view.names("view"))


def test_learning_ends_with_all_rows(result: StudyResult) -> None:
    (quality, _) = result.learning_curves
    sizes = [step.n_train for step in quality.steps]
    n = len(result.dataset("X").train)
    assert sizes == [n // 16, n // 8, n // 4, n // 2, n]


def test_dependence_is_of_both_sensors(result: StudyResult) -> None:
    assert [own.dataset for own in result.dependence] == ["X", "s2_X"]


def test_models_know_what_they_learnt_from(result: StudyResult) -> None:
    provenance = result.variant("e_k6").model.provenance
    assert provenance.observations == "the study's dataset eX_plusplus, training side"


def test_the_same_study_again_uses_what_is_there(
    result: StudyResult, folder: Path, settings: StudySettings
) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")}
    stages: dict[str, list[int]] = {}
    again = run_study(
        folder, settings, lambda stage, done, _: stages.setdefault(stage, []).append(done)
    )
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")} == before
    assert stages["training models"] == [29]
    assert table_files(again) == table_files(result)


# -- further predictors in the tables -----------------------------------------------------------


LINES = ("table", "dataset", "role", "features", "trained_on", "n_train", "n", "unit")


def lines_of(study: StudyResult, variant: str) -> pl.DataFrame:
    return study.tables.scores.filter(pl.col("variant") == variant)


def test_a_specification_is_evaluated_on_the_rows_of_the_papers_model(result: StudyResult) -> None:
    theirs = replace(model_named("e_k6"), name="theirs", title="in logarithms", target_scale="log")
    study = add_to_study(result, theirs, beside="e_k6")
    added, beside = lines_of(study, "theirs"), lines_of(study, "e_k6")
    assert_frame_equal(added.select(LINES), beside.select(LINES))
    assert added["rmse"].is_not_null().all()
    assert added["paper_rmse"].is_null().all()
    assert not added["rmse"].equals(beside["rmse"])


def test_the_papers_own_form_gets_the_papers_models_scores(result: StudyResult) -> None:
    again = replace(model_named("e_k6"), name="again")
    study = add_to_study(result, again, beside="e_k6")
    numbers = ("r2_percent", "rmse", "coverage_2sigma_percent")
    added, beside = lines_of(study, "again"), lines_of(study, "e_k6")
    assert_frame_equal(added.select(numbers), beside.select(numbers))


@dataclass(frozen=True, kw_only=True, eq=False)
class Mean(Predictor):
    """Predicts the mean of what it was trained on, whatever the inputs."""

    kind = "tests/mean"
    mean: float
    views: frozenset[str]

    @classmethod
    def train(cls, table: ObservationTable) -> "Mean":
        return cls(
            name="mean",
            title="a mean",
            target="p_norm",
            inputs=("i_avg",),
            provenance=Provenance.of(table),
            mean=table.frame["p_norm"].mean(),
            views=frozenset(table.names("view")),
        )

    def predict_frame(self, frame: pl.DataFrame) -> Prediction:
        mean = np.full(len(frame), self.mean)
        return Prediction(mean=mean, std=mean, inside=np.ones(len(frame), dtype=np.bool_))


def test_any_predictor_is_given_the_training_rows_alone(result: StudyResult) -> None:
    given: list[ObservationTable] = []

    def train(table: ObservationTable) -> Mean:
        given.append(table)
        return Mean.train(table)

    study = add_to_study(result, train, beside="q_k4")
    dataset = result.dataset("X")
    assert given == [dataset.train, dataset.train_by_view]
    by_role = dict(lines_of(study, "mean").select("role", "mse").iter_rows())
    observed = result.dataset("X_test").table.frame["p_norm"]
    error = observed - dataset.train.frame["p_norm"].mean()
    assert by_role["test"] == pytest.approx((error**2).mean())


def test_further_lines_end_their_tables_and_change_no_other(result: StudyResult) -> None:
    study = add_to_study(result, Mean.train, beside="q_k4")
    others = study.tables.scores.filter(pl.col("variant") != "mean")
    assert_frame_equal(others, result.tables.scores)
    for _, table in study.tables.scores.group_by("table"):
        assert "mean" not in table["variant"] or table["variant"][-1] == "mean"
    assert study.findings == result.findings
    assert b"mean,a mean" in table_files(study)["table-2.csv"]


@pytest.mark.parametrize(
    ("model", "beside", "message"),
    [
        (model_named("q_k1"), "q_k4", "a name that is not taken, got 'q_k1'"),
        (replace(model_named("e_k1"), name="theirs"), "q_k4", "which predicts exposure_ms"),
        (Mean.train, "e_k6", "a model beside e_k6 predicts exposure_ms"),
        (Mean.train, "q_k5", "no variant 'q_k5'"),
    ],
)
def test_a_predictor_that_does_not_belong_beside_a_model_is_refused(
    result: StudyResult, model: object, beside: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        add_to_study(result, model, beside=beside)


def test_a_damaged_model_is_trained_again(
    result: StudyResult,
    folder: Path,
    settings: StudySettings,
    caplog: pytest.LogCaptureFixture,
) -> None:
    (path,) = folder.glob("models/q_k1-*")
    whole = path.read_bytes()
    path.write_bytes(whole[:-200] + b"\0" * 100 + whole[-100:])
    again = run_study(folder, settings)
    assert "trained again" in caplog.text
    assert path.read_bytes() == whole
    assert table_files(again) == table_files(result)


@pytest.fixture
def study_process(campaigns: Path, tmp_path: Path) -> Iterator[subprocess.Popen[bytes]]:
    script = tmp_path / "study.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(campaigns), str(tmp_path / "study")]
    process = subprocess.Popen(command)
    yield process
    process.kill()
    process.wait()


@pytest.mark.slow
def test_a_killed_study_goes_on(
    study_process: subprocess.Popen[bytes],
    tmp_path: Path,
    result: StudyResult,
    settings: StudySettings,
) -> None:
    folder = tmp_path / "study"
    patience = time.monotonic() + 60
    while not list(folder.glob("models/*.exposight-model")):
        assert study_process.poll() is None
        assert time.monotonic() < patience
        time.sleep(0.01)
    study_process.kill()
    study_process.wait()
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("models/*.exposight-model")}
    assert len(kept) < 29
    resumed = run_study(folder, settings)
    assert (
        kept.items()
        <= {
            path: path.stat().st_mtime_ns for path in folder.glob("models/*.exposight-model")
        }.items()
    )
    assert table_files(resumed) == table_files(result)


def test_without_the_finer_campaign_there_are_fewer_rows(
    observe: Callable[..., ObservationTable], campaigns: Path, tmp_path: Path
) -> None:
    (tmp_path / "inside.csv").write_bytes((campaigns / "inside.csv").read_bytes())
    settings = StudySettings(
        quick=True, workers=1, campaigns=tmp_path, sensors=("structured-light",)
    )
    result = run_study(tmp_path / "study", settings)
    lighting = result.tables.scores.filter(pl.col("table") == 4)
    assert set(lighting["n"]) == {0}
    assert set(lighting["rmse"]) == {None}
    named = {own.name: own for own in result.findings}
    assert named["exposure-drifts-up"].holds is None


def test_campaigns_that_lack_features_are_refused(
    observe: Callable[..., ObservationTable], tmp_path: Path
) -> None:
    observe(["f1"]).write(tmp_path / "inside.csv")
    with pytest.raises(FeatureError, match="lacks the features"):
        run_study(tmp_path / "study", StudySettings(campaigns=tmp_path))


def test_an_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot be used for output"):
        run_study(tmp_path / "file")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"sensors": ("lidar",)},
            "one or both of structured-light, stereo, each once, got 'lidar'",
        ),
        ({"sensors": ()}, "got none"),
        ({"sensors": ("stereo", "stereo")}, "each once"),
        ({"seed": -1}, "seed must be a whole number from 0 up, got -1"),
        ({"workers": 0}, "at least 1 worker, got 0"),
    ],
)
def test_settings_that_cannot_be_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        StudySettings(**wrong)


def test_an_unknown_variant_is_refused(result: StudyResult) -> None:
    with pytest.raises(InputError, match="no variant 'q_k5'; it has q_k1, q_k2"):
        result.variant("q_k5")


def test_an_unknown_dataset_is_refused(result: StudyResult) -> None:
    with pytest.raises(InputError, match="no dataset 'Y'; it has X, X_test"):
        result.dataset("Y")


def test_a_score_that_a_variant_has_not_is_refused(result: StudyResult) -> None:
    with pytest.raises(InputError, match="variant 'q_k1' has no score 'test_inside'"):
        result.variant("q_k1").score("test_inside")

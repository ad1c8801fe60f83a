"""What decides a model's file, and that it is used again."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from exposight.cell import sensor_preset
from exposight.errors import ObservationError
from exposight.models import Training, model_named
from exposight.observing import ObservationTable
from exposight.paper import kept_models
from exposight.paper.kept_models import model_path, train_or_read
from exposight.workers import ignore_progress


@pytest.fixture
def wanted(observe: Callable[..., ObservationTable]) -> Training:
    return Training(
        specification=model_named("q_k1"),
        table=observe(["f1", "f2"]),
        source_sha256="ab" * 32,
        source="by hand",
        sensor=sensor_preset("comet-pro-ae"),
        seed=1,
        restarts=1,
    )


def test_the_same_training_has_the_same_file(wanted: Training) -> None:
    assert model_path(wanted, Path("a")) == model_path(replace(wanted), Path("a"))


def test_whatever_decides_a_model_decides_its_file(wanted: Training) -> None:
    others = [
        replace(wanted, seed=2),
        replace(wanted, restarts=2),
        replace(wanted, source_sha256="cd" * 32),
        replace(wanted, specification=model_named("q_k2")),
        replace(wanted, source="elsewhere"),
        replace(wanted, sensor=sensor_preset("rc-visard-65")),
    ]
    paths = {model_path(training, Path()) for training in (wanted, *others)}
    assert len(paths) == 1 + len(others)


def test_another_version_has_another_file(
    wanted: Training, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = model_path(wanted, Path())
    monkeypatch.setattr(kept_models, "__version__", "99")
    assert model_path(wanted, Path()) != path


def test_models_come_in_the_order_asked_for(
    wanted: Training, observe: Callable[..., ObservationTable], tmp_path: Path
) -> None:
    # The second takes longer, so it is trained first.
    longer = replace(wanted, table=observe(["f1", "f2", "f3"]), source_sha256=None)
    first, second = train_or_read([wanted, longer], tmp_path, workers=1, progress=ignore_progress)
    assert (first.n_observations, second.n_observations) == (60, 90)


def test_progress_counts_what_was_there(wanted: Training, tmp_path: Path) -> None:
    reports: list[tuple[int, int]] = []
    for _ in range(2):
        train_or_read([wanted], tmp_path, workers=1, progress=lambda *at: reports.append(at[1:]))
    assert reports == [(0, 1), (1, 1), (1, 1)]


def test_a_model_knows_its_training(wanted: Training, tmp_path: Path) -> None:
    (model,) = train_or_read([wanted], tmp_path, workers=1, progress=ignore_progress)
    assert model.provenance.observations == "by hand"
    assert model.provenance.observations_sha256 == wanted.source_sha256


def test_rows_that_cannot_be_learnt_from_are_refused(wanted: Training, tmp_path: Path) -> None:
    none = replace(wanted, table=ObservationTable.from_observations([]))
    with pytest.raises(ObservationError, match="cannot train q_k1"):
        train_or_read([none], tmp_path, workers=1, progress=ignore_progress)

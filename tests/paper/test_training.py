"""What decides a model's file, and that it is used again."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from exposight.cell import sensor_preset
from exposight.errors import ObservationError
from exposight.models import model_named
from exposight.observing import ObservationTable
from exposight.paper import training
from exposight.paper.training import KeptTraining, train_or_read


@pytest.fixture
def wanted(observe: Callable[..., ObservationTable]) -> KeptTraining:
    return KeptTraining(
        name="q_k1",
        specification=model_named("q_k1"),
        table=observe(["f1", "f2"]),
        source_sha256="ab" * 32,
        source="by hand",
        sensor=sensor_preset("comet-pro-ae"),
        seed=1,
        restarts=1,
    )


def test_the_same_training_has_the_same_file(wanted: KeptTraining) -> None:
    assert wanted.path(Path("a")) == replace(wanted).path(Path("a"))


def test_whatever_decides_a_model_decides_its_file(wanted: KeptTraining) -> None:
    others = [
        replace(wanted, seed=2),
        replace(wanted, restarts=2),
        replace(wanted, source_sha256="cd" * 32),
        replace(wanted, specification=model_named("q_k2")),
        replace(wanted, source="elsewhere"),
        replace(wanted, sensor=sensor_preset("rc-visard-65")),
    ]
    paths = {own.path(Path()) for own in (wanted, *others)}
    assert len(paths) == 1 + len(others)


def test_another_version_has_another_file(
    wanted: KeptTraining, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = wanted.path(Path())
    monkeypatch.setattr(training, "__version__", "99")
    assert wanted.path(Path()) != path


def test_models_come_in_the_order_asked_for(
    wanted: KeptTraining, observe: Callable[..., ObservationTable], tmp_path: Path
) -> None:
    # The second takes longer, so it is trained first.
    longer = replace(wanted, name="longer", table=observe(["f1", "f2", "f3"]), source_sha256=None)
    first, second = train_or_read([wanted, longer], tmp_path, workers=1, progress=lambda *_: None)
    assert (first.n_observations, second.n_observations) == (60, 90)


def test_progress_counts_what_was_there(wanted: KeptTraining, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    for _ in range(2):
        train_or_read([wanted], tmp_path, workers=1, progress=lambda *at: told.append(at[1:]))
    assert told == [(0, 1), (1, 1), (1, 1)]


def test_a_model_knows_its_training(wanted: KeptTraining, tmp_path: Path) -> None:
    (model,) = train_or_read([wanted], tmp_path, workers=1, progress=lambda *_: None)
    assert model.provenance.observations == "by hand"
    assert model.provenance.observations_sha256 == wanted.source_sha256


def test_rows_that_cannot_be_learnt_from_are_refused(wanted: KeptTraining, tmp_path: Path) -> None:
    none = replace(wanted, table=ObservationTable.from_observations([]))
    with pytest.raises(ObservationError, match="cannot train q_k1"):
        train_or_read([none], tmp_path, workers=1, progress=lambda *_: None)

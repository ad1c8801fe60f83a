"""What every demonstration is asked for and what it found: plain records, drawn by the report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from exposight.errors import InputError
from exposight.models import MODELS
from exposight.workers import usual_workers

if TYPE_CHECKING:
    from exposight.cell import ActiveSensor
    from exposight.models import Evaluation, GaussianProcessModel, ModelSpecification
    from exposight.observing import ObservationTable


@dataclass(frozen=True, kw_only=True)
class DemoSettings:
    """What every demonstration does.

    Parameters
    ----------
    seed : int
        Of everything random.
    restarts : int
        Starts of each model's optimiser; the paper took three.
    models : tuple of ModelSpecification
        Which ones are trained.
    workers : int
        Processes that work at the same time.

    Raises
    ------
    InputError
        If there is no restart, model or worker.
    """

    seed: int = 1
    restarts: int = 3
    models: tuple[ModelSpecification, ...] = MODELS
    workers: int = usual_workers()

    def __post_init__(self) -> None:
        if min(self.restarts, self.workers, len(self.models)) < 1:
            msg = (
                "a demonstration needs at least 1 of models, restarts and workers, got "
                f"{len(self.models)} models, {self.restarts} restarts, {self.workers} workers"
            )
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelResult:
    """A trained model, judged by the features it knows and by those it has never seen."""

    model: GaussianProcessModel
    known: Evaluation
    unseen: Evaluation
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DemoResult:
    """What every demonstration found.

    Parameters
    ----------
    output : Path
        Folder in which campaign, table and models are.
    sensor : ActiveSensor
        That measured.
    table : ObservationTable
        All observations.
    train_features : frozenset of str
        Names of the features that trained.
    results : tuple of ModelResult
        One for each model.
    """

    output: Path
    sensor: ActiveSensor
    table: ObservationTable
    train_features: frozenset[str]
    results: tuple[ModelResult, ...]

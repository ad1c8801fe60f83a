"""A sensor's two models: how good a point cloud will be, and which exposure time that takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.files import make_folder
from exposight.models import (
    MODEL_SUFFIX,
    Evaluation,
    ModelSpecification,
    Predictor,
    evaluate,
    load_model,
    model_named,
    save_model,
    train_all,
)
from exposight.observing import FeatureView, ObservationTable, View
from exposight.planning.forecasts import Forecast, forecast
from exposight.quantities import quantity
from exposight.tables import Column, Table
from exposight.workers import Progress, ignore_progress

DEFAULT_MODELS = ("q_k4", "e_k6")
"""What `train` and ``exposight train`` train, and reports forecast with where they are at hand.

The paper's best on features that nobody trained on (Sects. 3.3.6, 3.4.8), and so they are in the
simulated cell and on the recorded skull (``docs/the-paper.md``, ``make bench NAME=real``).
"""

_EXPOSURES = 61
"""Exposure times of a forecast, unless they are given."""

_SCORES = (
    Column(name="model"),
    Column(name="rows"),
    Column(name="n"),
    Column(name="r2_percent", label="R² %"),
    Column(name="rmse", label="RMSE", digits=3, error_of="target"),
    Column(name="mae", label="MAE", digits=3, error_of="target"),
    Column(name="coverage_1sigma", label="±1σ %", digits=3, scale=100.0),
    Column(name="coverage_2sigma", label="±2σ %", digits=3, scale=100.0),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelScores:
    """How well models predict observations, one evaluation for each; prints as a table."""

    evaluations: tuple[Evaluation, ...]

    @property
    def table(self) -> Table:
        """A row for each model and selection of rows: all, and those inside its training range."""
        rows = [
            {
                "model": evaluation.model.name,
                "target": evaluation.model.target,
                "rows": selection,
                **asdict(score),
            }
            for evaluation in self.evaluations
            for selection, score in (
                ("all", evaluation.score),
                ("inside", evaluation.score_inside),
            )
            if score is not None
        ]
        return Table.of("scores", rows, _SCORES)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is odd about the observations."""
        return tuple(remark for each in self.evaluations for remark in each.remarks)

    def __str__(self) -> str:
        return "\n".join((str(self.table), *self.remarks))

    def _repr_html_(self) -> str:
        return self.table._repr_html_()


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorModels:
    """A quality model and an exposure-time model of one sensor.

    Parameters
    ----------
    quality : Predictor
        Predicts p_norm.
    exposure : Predictor
        Predicts the exposure time in ms that yields a wanted brightness.

    Raises
    ------
    InputError
        If one of them predicts something else.
    """

    quality: Predictor
    exposure: Predictor

    def __post_init__(self) -> None:
        for model, target in ((self.quality, "p_norm"), (self.exposure, "exposure_ms")):
            if model.target != target:
                msg = f"expected a model that predicts {target}, got {model.name} ({model.target})"
                raise InputError(msg)

    @property
    def sensor(self) -> ActiveSensor | None:
        """The sensor that they were trained on, where they know it."""
        return self.exposure.sensor or self.quality.sensor

    def evaluate(self, table: ObservationTable) -> ModelScores:
        """Evaluate both models on held-out observations.

        Raises
        ------
        ObservationError
            If a model finds no row that it can be evaluated on.
        """
        return ModelScores(
            evaluations=(evaluate(self.quality, table), evaluate(self.exposure, table))
        )

    def forecast(
        self, view: View | Sequence[FeatureView], exposures_ms: Sequence[float] | None = None
    ) -> Forecast:
        """Predict the quality of the features that a view sees, over exposure time (`forecast`).

        `Campaign.view` returns what a pose sees. Exposure times, in ms, are settings of the sensor
        over the range that was trained on if they are left out.
        """
        times_ms = self._usual_exposures_ms() if exposures_ms is None else exposures_ms
        return forecast(self.quality, self.exposure, view, times_ms)

    def _usual_exposures_ms(self) -> tuple[float, ...]:
        limits = self.exposure.target_range
        if limits is None:
            msg = f"{self.exposure.name} does not know its training range: give exposures_ms"
            raise InputError(msg)
        if self.sensor is None:
            return tuple(np.geomspace(*limits, _EXPOSURES).tolist())
        possible = self.sensor.exposure
        low, high = np.clip(limits, possible.min_ms, possible.max_ms)
        times_ms = np.clip(np.geomspace(low, high, _EXPOSURES), low, high).tolist()
        return tuple(dict.fromkeys(map(self.sensor.nearest_exposure, times_ms)))

    def with_observations(self, table: ObservationTable) -> SensorModels:
        """Learn from more observations, as after a capture, without a new fit.

        The hyperparameters stay; where the new observations lie far from the old ones, train anew.

        Raises
        ------
        InputError
            If a model is of a kind that cannot, such as a committee.
        NotPositiveDefiniteError
            If the observations leave a covariance matrix without a Cholesky factor.
        """
        quality, exposure = (m.with_observations(table) for m in (self.quality, self.exposure))
        return SensorModels(quality=quality, exposure=exposure)

    def save(self, folder: str | Path) -> tuple[Path, Path]:
        """Write both models into a folder, made if it is not there, and return their files.

        Raises
        ------
        FileError
            If they cannot be written.
        """
        folder = make_folder(Path(folder), "the models")
        quality, exposure = (
            folder / f"{model.name}{MODEL_SUFFIX}" for model in (self.quality, self.exposure)
        )
        save_model(quality, self.quality)
        save_model(exposure, self.exposure)
        return quality, exposure

    @classmethod
    def load(cls, *paths: str | Path) -> SensorModels:
        """Read two model files, or the folder that holds them.

        Raises
        ------
        InputError
            If they are not one for quality and one for exposure time.
        FileError
            If a file cannot be read.
        """
        files = [
            file
            for path in map(Path, paths)
            for file in (sorted(path.glob(f"*{MODEL_SUFFIX}")) if path.is_dir() else (path,))
        ]
        quality, exposure = _one_of_each([load_model(file) for file in files])
        return cls(quality=quality, exposure=exposure)

    @property
    def table(self) -> Table:
        """What the two models read and predict, and how much they learnt from."""
        rows = [
            {
                "model": model.name,
                "predicts": quantity(model.target).name,
                "from": model.inputs,
                "rows": model.n_observations,
            }
            for model in (self.quality, self.exposure)
        ]
        columns = tuple(Column(name=name) for name in ("model", "predicts", "from", "rows"))
        return Table.of("models", rows, columns)

    def __str__(self) -> str:
        return str(self.table)

    def _repr_html_(self) -> str:
        return self.table._repr_html_()


_Model = TypeVar("_Model", "Predictor", "ModelSpecification")


def _one_of_each(models: Sequence[_Model]) -> tuple[_Model, _Model]:
    """Return the quality model and the exposure-time model of two."""
    by_target = {each.target: each for each in models}
    if len(models) != 2 or set(by_target) != {"p_norm", "exposure_ms"}:
        got = ", ".join(f"{each.name} ({each.target})" for each in models) or "none"
        msg = (
            "expected one model that predicts p_norm and one that predicts exposure_ms, got "
            f"{got}; give the two that are wanted"
        )
        raise InputError(msg)
    return by_target["p_norm"], by_target["exposure_ms"]


def train(
    table: ObservationTable,
    *,
    models: Sequence[str | ModelSpecification] = DEFAULT_MODELS,
    seed: int = 1,
    sensor: ActiveSensor | None = None,
    restarts: int = 3,
    workers: int = 1,
    cluster: str | None = None,
    progress: Progress = ignore_progress,
) -> SensorModels:
    """Train a quality model and an exposure-time model on observations of one sensor.

    Parameters
    ----------
    table : ObservationTable
    models : sequence of str or ModelSpecification
        One that predicts p_norm and one that predicts the exposure time, in any order: names of
        the paper's models, or one's own specifications.
    seed : int
        Random seed of the optimiser's restarts.
    sensor : ActiveSensor, optional
        The sensor of the observations; kept in the models.
    restarts : int
        Starts of the optimiser.
    workers, cluster, progress
        As for `exposight.models.run_trainings`, and so are further errors. More than one worker
        needs ``if __name__ == "__main__":`` around what a script does.

    Raises
    ------
    InputError
        If a model is unknown, or there is not one for each of quality and exposure time.
    """
    specifications = [model_named(each) if isinstance(each, str) else each for each in models]
    quality, exposure = train_all(
        _one_of_each(specifications),
        table,
        seed=seed,
        sensor=sensor,
        restarts=restarts,
        workers=workers,
        cluster=cluster,
        progress=progress,
    )
    return SensorModels(quality=quality, exposure=exposure)

"""Train the two models of a sensor: the default ones together, or the paper's."""

from __future__ import annotations

from collections.abc import Sequence

from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.models import (
    MeanKind,
    ModelSpecification,
    WindowModel,
    model_named,
    train_all,
    train_window,
)
from exposight.observing import ObservationTable
from exposight.planning.sensor_models import DEFAULT_MODELS, SensorModels, one_of_each
from exposight.workers import DaskCluster, Progress, ignore_progress


def train(
    table: ObservationTable,
    *,
    models: Sequence[str | ModelSpecification] = DEFAULT_MODELS,
    seed: int = 1,
    sensor: ActiveSensor | None = None,
    restarts: int = 3,
    workers: int = 1,
    cluster: str | DaskCluster | None = None,
    mean: MeanKind | None = None,
    start_from: WindowModel | None = None,
    progress: Progress = ignore_progress,
) -> SensorModels:
    """Train a quality model and an exposure-time model on observations of one sensor.

    Parameters
    ----------
    table : ObservationTable
    models : sequence of str or ModelSpecification
        The two default models, which are trained together; or one model that predicts p_norm and
        one that predicts the exposure time: names of the paper's, or one's own specifications.
    seed : int
        Random seed of the optimiser's restarts; the default models need none.
    sensor : ActiveSensor, optional
        The sensor of the observations; kept in the models. The default models take the preset that
        the table names if it is left out.
    restarts, workers, cluster
        Of the paper's models: starts of the optimiser, and as for `exposight.models.run_trainings`,
        and so are further errors. More than one worker needs ``if __name__ == "__main__":`` around
        what a script does.
    mean, start_from
        Of the default models: as for `exposight.models.train_window`.
    progress : Progress

    Raises
    ------
    InputError
        If a model is unknown, or there is not one for each of quality and exposure time.
    ObservationError
        If the observations are too few, none was measured, or they are of several sensors or
        finishes.
    """
    if all(isinstance(each, str) and each in DEFAULT_MODELS for each in models):
        progress("training models", 0, 1)
        quality = train_window(
            table, sensor=sensor, mean=mean, start_from=start_from, seed=seed, progress=progress
        )
        progress("training models", 1, 1)
        return SensorModels(quality=quality)
    specifications = [model_named(each) if isinstance(each, str) else each for each in models]
    if mean is not None or start_from is not None:
        names = ", ".join(each.name for each in specifications)
        msg = f"mean and start_from are of the default models, got them for {names}"
        raise InputError(msg)
    of_paper = train_all(
        one_of_each(specifications),
        table,
        seed=seed,
        sensor=sensor,
        restarts=restarts,
        workers=workers,
        cluster=cluster,
        progress=progress,
    )
    return SensorModels(quality=of_paper[0], exposure=of_paper[1])

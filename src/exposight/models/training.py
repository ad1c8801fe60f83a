"""Training: one model, or many in parallel on this machine or on a cluster."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import InputError, ObservationError
from exposight.gp import fit
from exposight.models.evaluation import check_rows
from exposight.models.gaussian_process import FitSummary, GaussianProcessModel
from exposight.models.predictor import Provenance
from exposight.models.specification import I_AVG_MAX, I_AVG_MIN
from exposight.workers import DaskCluster, LocalProcesses, Progress, Workers, ignore_progress

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from exposight.cell import ActiveSensor
    from exposight.models.specification import ModelSpecification
    from exposight.observing import ObservationTable

_STAGE = "training models"


@dataclass(frozen=True, kw_only=True, eq=False)
class Training:
    """A model to be trained: what `train` is called with.

    Parameters
    ----------
    specification, table, seed, source, source_sha256, sensor, restarts
        As for `train`.
    """

    specification: ModelSpecification
    table: ObservationTable
    seed: int
    source: str = "a table in memory"
    source_sha256: str | None = None
    sensor: ActiveSensor | None = None
    restarts: int = 3

    @property
    def cost(self) -> float:
        """Rises with the time that training takes: one factorisation for each search step."""
        parameters = len(self.specification.kernel.free_parameters)
        return float(len(self.table)) ** 3 * parameters

    def run(self, progress: Progress = ignore_progress) -> GaussianProcessModel:
        """Train the model (`train`)."""
        return train(
            self.specification,
            self.table,
            seed=self.seed,
            source=self.source,
            source_sha256=self.source_sha256,
            sensor=self.sensor,
            restarts=self.restarts,
            progress=progress,
        )


def run_trainings(
    trainings: Sequence[Training],
    *,
    workers: int = 1,
    cluster: str | None = None,
    progress: Progress = ignore_progress,
) -> Generator[tuple[Training, GaussianProcessModel]]:
    """Train models in parallel, the longest first, and yield each as soon as it is trained.

    The models are the same for any number of workers, here or on a cluster. Close the generator
    (`contextlib.closing`) to be sure that no further training begins.

    Parameters
    ----------
    trainings : sequence of Training
        What to train.
    workers : int, 1 or more
        Models that are trained at the same time, each in a process of its own; 1 trains in this
        process.
    cluster : str, optional
        Address of a Dask scheduler whose workers train instead, such as ``tcp://host:8786``.
    progress : Progress
        Receives the models that are trained; where only one is trained at a time, also the
        starts of its optimiser.

    Raises
    ------
    InputError
        If there is no worker, or there are workers here and a cluster, or no such cluster.
    ObservationError, NumericalError
        As for `train`, or if workers die.
    """
    if cluster is not None and workers != 1:
        msg = (
            f"models are trained by processes here or by a cluster, got {workers} workers and "
            f"the cluster {cluster!r}; choose one"
        )
        raise InputError(msg)
    ordered = sorted(trainings, key=lambda training: training.cost, reverse=True)
    pool: Workers = DaskCluster(cluster) if cluster is not None else LocalProcesses(workers)
    progress(_STAGE, 0, len(ordered))
    if cluster is None and min(workers, len(ordered)) <= 1:
        for done, training in enumerate(ordered, start=1):
            yield training, training.run(progress)
            progress(_STAGE, done, len(ordered))
        return
    with closing(pool.run(Training.run, ordered)) as results:
        for done, (training, model) in enumerate(results, start=1):
            progress(_STAGE, done, len(ordered))
            yield training, model


def train_all(
    specifications: Sequence[ModelSpecification],
    table: ObservationTable,
    *,
    seed: int,
    source: str = "a table in memory",
    source_sha256: str | None = None,
    sensor: ActiveSensor | None = None,
    restarts: int = 3,
    workers: int = 1,
    cluster: str | None = None,
    progress: Progress = ignore_progress,
) -> tuple[GaussianProcessModel, ...]:
    """Train several models on one table, in parallel.

    Parameters
    ----------
    specifications : sequence of ModelSpecification
        Which models.
    table, seed, source, source_sha256, sensor, restarts
        As for `train`.
    workers, cluster, progress
        As for `run_trainings`.

    Returns
    -------
    tuple of GaussianProcessModel
        In the order of `specifications`.

    Raises
    ------
    InputError, ObservationError, NumericalError
        As for `run_trainings`.
    """
    trainings = [
        Training(
            specification=specification,
            table=table,
            seed=seed,
            source=source,
            source_sha256=source_sha256,
            sensor=sensor,
            restarts=restarts,
        )
        for specification in specifications
    ]
    with closing(
        run_trainings(trainings, workers=workers, cluster=cluster, progress=progress)
    ) as results:
        models = {id(training): model for training, model in results}
    return tuple(models[id(training)] for training in trainings)


def train(
    specification: ModelSpecification,
    table: ObservationTable,
    *,
    seed: int,
    source: str = "a table in memory",
    source_sha256: str | None = None,
    sensor: ActiveSensor | None = None,
    restarts: int = 3,
    progress: Progress = ignore_progress,
) -> GaussianProcessModel:
    """Train one of the paper's models.

    Parameters
    ----------
    specification : ModelSpecification
        Which one.
    table : ObservationTable
        Observations; rows that were not measured, or not well enough for this model, are left
        out (`ModelSpecification.rows`).
    seed : int
        Of the restarts.
    source : str
        What the table is, for instance its file's name; kept in the model.
    source_sha256 : str, optional
        Checksum of that file; kept in the model.
    sensor : ActiveSensor, optional
        The sensor that the observations are of; kept in the model.
    restarts : int
        Starts of the optimiser; the paper took three (Sect. 3.3.4).
    progress : Progress
        Receives the starts that are done.

    Returns
    -------
    GaussianProcessModel

    Raises
    ------
    ObservationError
        If no row is left, or too few, or they are all alike.
    NumericalError
        If no start of the optimiser gave a valid model.
    """
    stage = f"training {specification.name}"
    rows = specification.rows(table)
    check_rows(specification.name, "train", rows, table, specification.p_norm_min)
    x, y = specification.data(rows)
    if specification.kernel.gate(x).all():  # else told without the column's name
        grey = x[:, specification.inputs.index("i_avg")]
        lies = f"lies outside grey levels {I_AVG_MIN:g} to {I_AVG_MAX:g}"
        if grey.max() < I_AVG_MIN:
            lies = f"is below grey level {I_AVG_MIN:g}"
        msg = (
            f"cannot train {specification.name}: i_avg {lies} in every row (rows: {len(x)}, i_avg: "
            f"{grey.min():g} to {grey.max():g}), where the model is 0 by design (it learns from "
            f"{I_AVG_MIN:g} to {I_AVG_MAX:g}); add longer exposure times, and check that i_avg is "
            "a mean grey level of 0 to 255"
        )
        raise ObservationError(msg)
    progress(stage, 0, restarts)
    result = fit(
        specification.kernel,
        x,
        y,
        rng=np.random.default_rng(seed),
        restarts=restarts,
        progress=lambda _, done, total: progress(stage, done, total),
    )
    return GaussianProcessModel(
        name=specification.name,
        title=specification.title,
        target=specification.target,
        inputs=specification.inputs,
        p_norm_min=specification.p_norm_min,
        source=specification.source,
        process=result.process,
        summary=FitSummary(
            log_marginal_likelihood=result.log_marginal_likelihood,
            converged=result.converged,
            evaluations=result.evaluations,
            starts=len(result.starts),
            parameters_at_bound=result.parameters_at_bound,
            seconds=result.seconds,
        ),
        provenance=Provenance.of(rows, source=source, sha256=source_sha256, seed=seed),
        sensor=sensor,
    )

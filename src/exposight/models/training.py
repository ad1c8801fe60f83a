"""Training: one model, or many in parallel on this machine or on a cluster."""

import logging
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight import gp
from exposight.cell import ActiveSensor
from exposight.errors import ObservationError
from exposight.gp.cost import committee_seconds, fit_seconds
from exposight.models.evaluation import check_exposures, check_rows
from exposight.models.gaussian_process import FitSummary, GaussianProcessModel
from exposight.models.predictor import Provenance
from exposight.models.specification import I_AVG_MAX, I_AVG_MIN, ModelSpecification
from exposight.observing import ObservationTable
from exposight.workers import (
    DaskCluster,
    Progress,
    as_cluster,
    choose_workers,
    ignore_progress,
)

_Likelihood: TypeAlias = "tuple[float, NDArray[np.float64]]"

logger = logging.getLogger(__name__)

_STAGE = "training models"

_WORTH_SAYING_ROWS = 500
"""Of fewer rows training takes no longer than foretelling it."""

COMMITTEE_ROWS = 3000
"""Above so many rows a committee of exact experts is trained in place of one exact process: a tenth
of the time there, a fortieth at 6000, at the same error (measured in `exposight.gp.committee`)."""

_SHARD_SIZE, _COMMUNICATION = 2000, 1000
"""Rows of one expert at most, and rows that all experts share (`fit_committee`)."""

_SEARCHED_SHARDS = 8
"""Shards on which hyperparameters are searched at most: 17 000 rows tell a handful of numbers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Training:
    """A model to be trained.

    Parameters
    ----------
    specification : ModelSpecification
        One of the paper's, or one's own.
    table : ObservationTable
        Observations; rows that were not measured, or not well enough for this model, are left
        out (`ModelSpecification.rows`).
    seed : int
        Random seed of the restarts.
    source : str
        What the table is, for instance its file's name; kept in the model.
    source_sha256 : str, optional
        Checksum of that file; kept in the model.
    sensor : ActiveSensor, optional
        The sensor that the observations are of; kept in the model.
    restarts : int
        Starts of the optimiser; the paper took three (Sect. 3.3.4).
    committee_rows : int, optional
        With more rows than this, train a committee of exact experts; None never does.
    """

    specification: ModelSpecification
    table: ObservationTable
    seed: int
    source: str = "a table in memory"
    source_sha256: str | None = None
    sensor: ActiveSensor | None = None
    restarts: int = 3
    committee_rows: int | None = COMMITTEE_ROWS

    @property
    def needs_committee(self) -> bool:
        """Whether a committee of experts is going to be trained."""
        rows = len(self.specification.rows(self.table))
        return self.committee_rows is not None and rows > self.committee_rows

    @property
    def cost(self) -> float:
        """Rises with the time that training takes: one factorisation for each search step."""
        parameters = len(self.specification.kernel.free_parameters)
        return float(len(self.table)) ** 3 * parameters

    @property
    def expected_s(self) -> float:
        """About how many CPU seconds training takes, by a law measured on this machine."""
        rows, limit = len(self.specification.rows(self.table)), self.committee_rows
        if limit is None or rows <= limit:
            return fit_seconds(rows, starts=self.restarts)
        return committee_seconds(
            rows,
            shard_size=min(_SHARD_SIZE, 2 * limit // 3),
            communication=min(_COMMUNICATION, limit // 3),
            search_shards=_SEARCHED_SHARDS,
            starts=self.restarts,
        )

    def run(
        self, progress: Progress = ignore_progress, *, cluster: str | DaskCluster | None = None
    ) -> GaussianProcessModel:
        """Train the model.

        Parameters
        ----------
        progress : Progress
            Receives the starts that are done.
        cluster : str or DaskCluster, optional
            Address of a Dask scheduler whose workers evaluate a committee's shards; threads of this
            process do it if left out. One exact process is always trained here.

        Raises
        ------
        SensorError
            If the sensor cannot have taken a recorded exposure time.
        ObservationError
            If no row is left, or too few, or they are all alike.
        NumericalError
            If no start of the optimiser gave a valid model.
        """
        specification, restarts, limit = self.specification, self.restarts, self.committee_rows
        rows = specification.rows(self.table)
        check_rows(specification.name, "train", rows, self.table, specification.p_norm_min)
        check_exposures(rows, self.sensor)
        x, y = specification.data(rows)
        n_lit = self._check_brightness(x)
        if n_lit > _WORTH_SAYING_ROWS:
            logger.info("training %s: about %.3g CPU s", specification.name, self.expected_s)

        def report(stage: str, done: int, total: int) -> None:
            name = f"training {specification.name}"
            progress(f"{name}, {stage}" if stage == gp.EVALUATIONS else name, done, total)

        report("", 0, restarts)
        kernel, rng = specification.kernel, np.random.default_rng(self.seed)
        process: gp.GaussianProcess | gp.Committee
        result: gp.FitResult | gp.CommitteeFitResult
        if limit is None or n_lit <= limit:
            result = gp.fit(kernel, x, y, rng=rng, restarts=restarts, progress=report)
            process = result.process
        else:
            result = gp.fit_committee(
                kernel,
                x,
                y,
                rng=rng,
                restarts=restarts,
                shard_size=min(_SHARD_SIZE, 2 * limit // 3),
                communication=min(_COMMUNICATION, limit // 3),
                search_shards=_SEARCHED_SHARDS,
                shard_map=None if cluster is None else partial(_on_cluster, as_cluster(cluster)),
                progress=report,
            )
            process = result.committee
        return GaussianProcessModel(
            name=specification.name,
            title=specification.title,
            target=specification.target,
            inputs=specification.inputs,
            p_norm_min=specification.p_norm_min,
            source=specification.source,
            target_scale=specification.target_scale,
            process=process,
            summary=FitSummary(
                log_marginal_likelihood=result.log_marginal_likelihood,
                converged=result.converged,
                evaluations=result.evaluations,
                starts=restarts,
                parameters_at_bound=result.parameters_at_bound,
                seconds=result.seconds,
            ),
            provenance=Provenance.of(
                rows, source=self.source, sha256=self.source_sha256, seed=self.seed
            ),
            sensor=self.sensor,
        )

    def _check_brightness(self, x: NDArray[np.float64]) -> int:
        """Count the rows that the kernel does not switch off; there must be some."""
        specification = self.specification
        n_lit = int(np.count_nonzero(~specification.kernel.gate(x)))
        if n_lit or "i_avg" not in specification.inputs:
            return n_lit
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


def run_trainings(
    trainings: Sequence[Training],
    *,
    workers: int = 1,
    cluster: str | DaskCluster | None = None,
    progress: Progress = ignore_progress,
) -> Generator[tuple[Training, GaussianProcessModel]]:
    """Train models in parallel, the longest first, and yield each as soon as it is trained.

    The models are the same for any number of workers, here or on a cluster. Close the generator
    (`contextlib.closing`) to be sure that no further training begins.

    Parameters
    ----------
    trainings : sequence of Training
    workers : int, 1 or more
        Models that are trained at the same time, each in a process of its own; 1 trains in this
        process.
    cluster : str or DaskCluster, optional
        Address of a Dask scheduler whose workers train instead, such as ``tcp://host:8786``;
        of a single model with a committee, each trains a share of the experts.
    progress : Progress
        Receives the models that are trained; where only one is trained at a time, also the
        starts of its optimiser.

    Raises
    ------
    InputError
        If there is no worker, or there are workers here and a cluster, or no such cluster.
    ObservationError, NumericalError
        As for `Training.run`, or if workers die.
    """
    ordered = sorted(trainings, key=lambda training: training.cost, reverse=True)
    pool = choose_workers(workers, cluster)
    progress(_STAGE, 0, len(ordered))
    alone = len(ordered) == 1 and ordered[0].needs_committee  # its shards are shared out instead
    if alone or (cluster is None and min(workers, len(ordered)) <= 1):
        for done, training in enumerate(ordered, start=1):
            yield training, training.run(progress, cluster=cluster)
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
    workers: int = 1,
    cluster: str | DaskCluster | None = None,
    progress: Progress = ignore_progress,
    **settings: Any,
) -> tuple[GaussianProcessModel, ...]:
    """Train several models on one table, in parallel.

    Settings are those of `Training`; workers, cluster, progress and errors those of
    `run_trainings`. The models come in the order of `specifications`.
    """
    trainings = [Training(specification=each, table=table, **settings) for each in specifications]
    with closing(
        run_trainings(trainings, workers=workers, cluster=cluster, progress=progress)
    ) as results:
        models = {id(training): model for training, model in results}
    return tuple(models[id(training)] for training in trainings)


def _on_cluster(
    cluster: DaskCluster, work: Callable[[gp.ShardTask], _Likelihood], tasks: Sequence[gp.ShardTask]
) -> list[_Likelihood]:
    """Evaluate shards on a cluster; results in the order of the tasks (`ShardMap`)."""
    with closing(cluster.run(work, tasks)) as results:
        by_task = {id(task): result for task, result in results}
    return [by_task[id(task)] for task in tasks]

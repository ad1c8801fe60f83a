"""Models trained several at a time, each kept as a file and used again while its inputs are.

A model's file is called after a checksum of all that decides it: its kernel and inputs, the rows it
learns from, the seed and number of starts, and the program's version.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from exposight import __version__
from exposight.errors import FileError
from exposight.models import MODEL_SUFFIX, load_model, save_model, train
from exposight.workers import LocalProcesses

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from exposight.cell import ActiveSensor
    from exposight.models import ModelSpecification, TrainedModel
    from exposight.observing import ObservationTable


_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class Training:
    """A model to be trained.

    Parameters
    ----------
    name : str
        Begins the name of its file.
    specification : ModelSpecification
        Which model.
    rows : ObservationTable
        What it learns from.
    source : str
        What the rows are; kept in the model.
    sensor : ActiveSensor
        That measured them; kept in the model.
    seed : int
        Of the restarts.
    restarts : int
        Starts of the optimiser.
    """

    name: str
    specification: ModelSpecification
    rows: ObservationTable
    source: str
    sensor: ActiveSensor
    seed: int
    restarts: int

    def path(self, folder: Path) -> Path:
        """Return the file in a folder that holds this very model."""
        decisive = {
            "specification": [
                self.specification.name,
                self.specification.target,
                self.specification.inputs,
                self.specification.kernel.to_dict(),
                self.specification.p_norm_min,
            ],
            "rows": table_checksum(self.rows),
            "source": self.source,
            "sensor": self.sensor.to_json(),
            "seed": self.seed,
            "restarts": self.restarts,
            "version": __version__,
        }
        text = json.dumps(decisive, sort_keys=True)
        return folder / f"{self.name}-{_short(text.encode())}{MODEL_SUFFIX}"


def train_all(
    trainings: Sequence[Training],
    folder: Path,
    *,
    workers: int,
    progress: Callable[[int, int], None],
) -> tuple[TrainedModel, ...]:
    """Train models, or take those that an earlier run trained.

    Parameters
    ----------
    trainings : sequence of Training
        What to train.
    folder : Path
        Where models are kept; it must exist.
    workers : int, 1 or more
        Models that are trained at the same time.
    progress : callable
        Called with (models there, models in all).

    Returns
    -------
    tuple of TrainedModel
        In the order of `trainings`, always as read from their files.

    Raises
    ------
    ObservationError, NumericalError
        As for `train`.
    FileError
        If a model cannot be written.
    """
    paths = [training.path(folder) for training in trainings]
    found = [_kept(path) for path in paths]
    missing = [
        _Task(training=training, path=path)
        for training, path, model in zip(trainings, paths, found, strict=True)
        if model is None
    ]
    # The longest first, so that no worker is left alone with it at the end.
    missing.sort(key=lambda task: task.cost, reverse=True)
    done = len(trainings) - len(missing)
    progress(done, len(trainings))
    with closing(LocalProcesses(workers).run(_train_and_keep, missing)) as results:
        for _ in results:
            done += 1
            progress(done, len(trainings))
    return tuple(
        load_model(path) if model is None else model
        for path, model in zip(paths, found, strict=True)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    training: Training
    path: Path

    @property
    def cost(self) -> float:
        """Rises with the time that training takes: a factorisation for each step of the search."""
        parameters = len(self.training.specification.kernel.free_parameters)
        return float(len(self.training.rows)) ** 3 * parameters


def _train_and_keep(task: _Task) -> None:
    own = task.training
    model = train(
        own.specification,
        own.rows,
        seed=own.seed,
        source=own.source,
        source_sha256=table_checksum(own.rows),
        sensor=own.sensor,
        restarts=own.restarts,
    )
    save_model(task.path, model)


def _kept(path: Path) -> TrainedModel | None:
    """Return the model that an earlier run kept; a damaged one is trained again."""
    if not path.is_file():
        return None
    try:
        return load_model(path)
    except FileError as error:
        _logger.warning("trained again: %s", error)
        return None


def table_checksum(table: ObservationTable) -> str:
    """Return the SHA-256 of a table's rows, as CSV."""
    buffer = io.BytesIO()
    table.frame.write_csv(buffer)
    return hashlib.sha256(buffer.getvalue()).hexdigest()


def _short(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:12]

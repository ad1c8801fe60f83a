"""Models trained in parallel, each kept as a file and used again while its inputs are the same.

A model's file is called after a checksum of all that decides it: its kernel and inputs, the rows it
learns from, the seed and number of starts, and the program's version.
"""

import json
import logging
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from exposight import __version__, models
from exposight.errors import FileError
from exposight.files import csv_of, sha256_of
from exposight.observing import ObservationTable
from exposight.workers import Progress

_STAGE = "training models"

_logger = logging.getLogger(__name__)


def train_or_read(
    trainings: Sequence[models.Training],
    folder: Path,
    *,
    workers: int,
    progress: Progress,
) -> tuple[models.GaussianProcessModel, ...]:
    """Train models, or read those that an earlier run trained.

    Parameters
    ----------
    trainings : sequence of models.Training
        What to train; `source_sha256` must be the checksum of the rows (`table_checksum`).
    folder : Path
        Where models are kept; it must exist.
    workers : int, 1 or more
        Models that are trained at the same time.
    progress : Progress
        Receives the models that are complete.

    Returns
    -------
    tuple of models.GaussianProcessModel
        In the order of `trainings`, always as read from their files.

    Raises
    ------
    ObservationError, NumericalError
        As for `train`.
    FileError
        If a model cannot be written.
    """
    paths = [model_path(training, folder) for training in trainings]
    kept = [_kept(path) for path in paths]
    missing = {
        id(training): path
        for training, path, model in zip(trainings, paths, kept, strict=True)
        if model is None
    }
    queue = [training for training in trainings if id(training) in missing]
    done = len(trainings) - len(queue)
    progress(_STAGE, done, len(trainings))
    with closing(models.run_trainings(queue, workers=workers)) as results:
        for training, model in results:
            models.save_model(missing[id(training)], model)
            done += 1
            progress(_STAGE, done, len(trainings))
    return tuple(
        models.load_model(path, models.GaussianProcessModel) if model is None else model
        for path, model in zip(paths, kept, strict=True)
    )


def model_path(training: models.Training, folder: Path) -> Path:
    """Return the file in a folder that holds the model of exactly this training."""
    specification = training.specification
    decisive = {
        "specification": [
            specification.name,
            specification.target,
            specification.inputs,
            specification.kernel.to_dict(),
            specification.p_norm_min,
            specification.target_scale,
        ],
        "rows": training.source_sha256,
        "source": training.source,
        "sensor": training.sensor.to_json() if training.sensor else None,
        "seed": training.seed,
        "restarts": training.restarts,
        "version": __version__,
    }
    checksum = sha256_of(json.dumps(decisive, sort_keys=True).encode())[:12]
    return folder / f"{specification.name}-{checksum}{models.MODEL_SUFFIX}"


def _kept(path: Path) -> models.GaussianProcessModel | None:
    """Return the model that an earlier run kept; a damaged one is trained again."""
    if not path.is_file():
        return None
    try:
        return models.load_model(path, models.GaussianProcessModel)
    except FileError as error:
        _logger.warning("trained again: %s", error)
        return None


def table_checksum(table: ObservationTable) -> str:
    """Return the SHA-256 of a table's rows, as CSV."""
    return sha256_of(csv_of(table.frame))

"""The part that all demonstrations share: a table of observations becomes judged models on disk."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.demo.result import DemoSettings, ModelResult
from exposight.errors import FileError
from exposight.models import MODEL_SUFFIX, evaluate, save_model, train

if TYPE_CHECKING:
    from pathlib import Path

    from exposight.cell import ActiveSensor
    from exposight.models import ModelSpecification
    from exposight.observing import ObservationTable

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, what of it is done, and how much there is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lesson:
    """What models learn from and are judged by.

    Parameters
    ----------
    known : ObservationTable
        Observations of the features that train.
    unseen : ObservationTable
        Observations of the others.
    sensor : ActiveSensor
        That measured; kept in the models.
    source : str
        What the known observations are; kept in the models.
    """

    known: ObservationTable
    unseen: ObservationTable
    sensor: ActiveSensor
    source: str


def make_folder(folder: Path) -> Path:
    """Make a folder if it is not there, and return it.

    Raises
    ------
    FileError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f"{folder} cannot be used for output: {error.strerror or error}"
        raise FileError(msg) from error
    return folder


def silent(stage: str, done: int, total: int) -> None:
    """Tell nobody how far work is."""


def train_models(
    folder: Path, lesson: Lesson, settings: DemoSettings, tell: Progress
) -> tuple[ModelResult, ...]:
    """Train, judge and save the models, several at a time.

    Parameters
    ----------
    folder : Path
        Where the models are saved; made if it is not there.
    lesson : Lesson
        What they learn from and are judged by.
    settings : DemoSettings
        Which models, and how.
    tell : callable
        Called with (stage, done, total).

    Returns
    -------
    tuple of ModelResult
        In the order of the settings.
    """
    make_folder(folder)
    results = []
    tell("training models", 0, len(settings.models))
    for result in _train_all(lesson, settings):
        save_model(folder / f"{result.model.specification.name}{MODEL_SUFFIX}", result.model)
        results.append(result)
        tell("training models", len(results), len(settings.models))
    return tuple(
        sorted(results, key=lambda found: settings.models.index(found.model.specification))
    )


def _train_all(lesson: Lesson, settings: DemoSettings) -> Iterator[ModelResult]:
    """Train models, several at a time, and yield each as soon as it is done."""
    workers = min(settings.workers, len(settings.models))
    if workers == 1:
        yield from (_train_one(model, lesson, settings) for model in settings.models)
        return
    # Fresh processes: forking one that has run compiled threads can hang.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=workers, mp_context=context) as pool:
        try:
            futures = [pool.submit(_train_one, own, lesson, settings) for own in settings.models]
            yield from (future.result() for future in as_completed(futures))
        except BaseException:  # an interrupt too: do not begin what is still waiting
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _train_one(
    specification: ModelSpecification, lesson: Lesson, settings: DemoSettings
) -> ModelResult:
    start = time.perf_counter()
    model = train(
        specification,
        lesson.known,
        seed=settings.seed,
        source=lesson.source,
        sensor=lesson.sensor,
        restarts=settings.restarts,
    )
    seconds = time.perf_counter() - start
    return ModelResult(
        model=model,
        known=evaluate(model, lesson.known),
        unseen=evaluate(model, lesson.unseen),
        seconds=seconds,
    )

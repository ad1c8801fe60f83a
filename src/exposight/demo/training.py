"""The part that all demonstrations share: a table of observations becomes judged models on disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.demo.result import DemoSettings, ModelResult
from exposight.errors import FileError
from exposight.models import MODEL_SUFFIX, evaluate, save_model, train_all
from exposight.workers import Progress

if TYPE_CHECKING:
    from pathlib import Path

    from exposight.cell import ActiveSensor
    from exposight.observing import ObservationTable


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
    models = train_all(
        settings.models,
        lesson.known,
        seed=settings.seed,
        source=lesson.source,
        sensor=lesson.sensor,
        restarts=settings.restarts,
        workers=settings.workers,
        progress=tell,
    )
    results = []
    for model in models:
        save_model(folder / f"{model.name}{MODEL_SUFFIX}", model)
        results.append(
            ModelResult(
                model=model,
                known=evaluate(model, lesson.known),
                unseen=evaluate(model, lesson.unseen),
                seconds=model.summary.seconds or 0.0,
            )
        )
    return tuple(results)

"""What a strategy had and took in one view: a row of a comparison and of its results file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl

from exposight.errors import InputError
from exposight.planning.comparing.strategies import MeasuringCosts, Trial
from exposight.planning.comparing.strategies.rehearsal import time_ms


@dataclass(frozen=True, kw_only=True)
class ViewOutcome:
    """One strategy in one view.

    Parameters
    ----------
    strategy, kind, title : str
        The strategy; with the names of its models where there are several.
    view : str
        The view.
    coverable : int
        Features that some exposure time serves.
    had : int
        Features that a capture brought to the quality.
    captures_ms, trial_images_ms : tuple of float, ms
        What was taken, in order.
    time_s : float, s
        What that took.
    promises : int
        Features to which a chance was promised.
    promised : float
        Sum of these chances.
    kept : int
        How many of these features were had.
    promise_loss : float
        Squared errors of these chances, summed.
    chances : int
        Pairs of feature and exposure time whose chance was said.
    chance_loss : float
        Squared errors of these chances, summed.
    """

    strategy: str
    kind: str
    title: str
    view: str
    coverable: int
    had: int
    captures_ms: tuple[float, ...]
    trial_images_ms: tuple[float, ...]
    time_s: float
    promises: int = 0
    promised: float = 0.0
    kept: int = 0
    promise_loss: float = 0.0
    chances: int = 0
    chance_loss: float = 0.0

    def __post_init__(self) -> None:
        counts = (self.had, self.kept, self.promises, self.chances)
        sums = (self.time_s, self.promised, self.promise_loss, self.chance_loss)
        times = (*self.captures_ms, *self.trial_images_ms)
        # Sums of chances are rounded.
        if (
            min(*counts, *sums) < 0
            or self.had > self.coverable
            or self.kept > self.promises
            or self.promised > self.promises * (1.0 + 1e-9)
            or min(times, default=1.0) <= 0.0
        ):
            msg = (
                f"outcome of {self.strategy!r} in view {self.view!r}: counts and sums are 0 or "
                "more, no more features are had than can be or were promised, and exposure times "
                f"lie above 0 ms; got {self}"
            )
            raise InputError(msg)

    @classmethod
    def of(
        cls, trial: Trial, costs: MeasuringCosts, *, strategy: str, kind: str, title: str
    ) -> ViewOutcome:
        """Score a view that a strategy has measured."""
        served = trial.of.p_norm >= trial.need
        had, promises, chances = trial.had, trial.promises, trial.chances
        return cls(
            strategy=strategy,
            kind=kind,
            title=title,
            view=trial.view,
            coverable=int(served.any(axis=1).sum()),
            had=len(had),
            captures_ms=trial.captures_ms,
            trial_images_ms=trial.trial_images_ms,
            time_s=time_ms(trial, costs) / 1000.0,
            promises=len(promises),
            promised=float(sum(promises.values())),
            kept=sum(name in had for name in promises),
            promise_loss=float(sum((p - (name in had)) ** 2 for name, p in promises.items())),
            chances=0 if chances is None else chances.size,
            chance_loss=0.0 if chances is None else float(np.sum((chances - served) ** 2)),
        )


def frame_of(outcomes: tuple[ViewOutcome, ...]) -> pl.DataFrame:
    """Return outcomes as a frame, a row for each."""
    return pl.DataFrame([vars(each) for each in outcomes], infer_schema_length=None)

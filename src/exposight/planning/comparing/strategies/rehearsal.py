"""Constants of a strategy, chosen on views that it may rehearse on.

Chosen on the very views that are compared, in hindsight, constants are better than anybody could
choose them beforehand: generous to the strategy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from exposight.planning.comparing.strategies.contract import MeasuringCosts, Method, Setup, Trial
from exposight.planning.comparing.sweeps import Sweep

_AS_GOOD = 0.005
"""Share of the features that a quicker choice may cover less than the one that covers most."""


@dataclass(frozen=True, kw_only=True)
class Totals:
    """What a method had and took over all views of a sweep."""

    had: int
    exposures: int
    time_ms: float


def rehearse(method: Method, setup: Setup) -> Totals:
    """Measure all views of the rehearsal by a method."""
    return _totals((trial for trial in measured(method, setup.rehearsal, setup)), setup.costs)


def measured(method: Method, sweep: Sweep, setup: Setup) -> Iterable[Trial]:
    """Measure a sweep's views one after the other, and yield each with what was taken."""
    for view in sweep.views:
        trial = Trial(sweep=sweep, of=view, limits=setup.limits)
        method(trial)
        yield trial


def time_ms(trial: Trial, costs: MeasuringCosts) -> float:
    """Return how long the captures and trial images of a view take."""
    captures = map(costs.capture.capture_ms, trial.captures_ms)
    return sum(captures) + sum(map(costs.trial_image.capture_ms, trial.trial_images_ms))


def _totals(trials: Iterable[Trial], costs: MeasuringCosts) -> Totals:
    had, exposures, total_ms = 0, 0, 0.0
    for trial in trials:
        had += len(trial.had)
        exposures += len(trial.captures_ms) + len(trial.trial_images_ms)
        total_ms += time_ms(trial, costs)
    return Totals(had=had, exposures=exposures, time_ms=total_ms)


def best_of(
    make: Callable[..., Method], constants: Sequence[Sequence[Any]]
) -> Callable[[Setup], Method]:
    """Return the start of a strategy whose constants are chosen on the rehearsal.

    Chosen is what covers most features, or half a percent less in the fewest exposures, trial
    images among them; of those the quickest.

    Parameters
    ----------
    make : callable
        Makes a method of constants.
    constants : sequence of sequence
        The choices.
    """

    def start(setup: Setup) -> Method:
        methods = [make(*each) for each in constants]
        totals = [rehearse(method, setup) for method in methods]
        least = max(each.had for each in totals) - _AS_GOOD * setup.rehearsal.pairs
        good = [i for i, each in enumerate(totals) if each.had >= least]
        return methods[min(good, key=lambda i: (totals[i].exposures, totals[i].time_ms))]

    return start

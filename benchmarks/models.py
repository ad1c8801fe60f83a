"""How well radiance and window models predict, beside the paper's chain of two models.

Run with ``make bench NAME=models``. The simulated campaigns (`benchmarks.models_campaigns`, three
seeds each) are measured and the paper's models are trained where exposight's cache does not have
them, which takes half an hour on two cores; else it takes some four minutes. Both kinds of model
learn from the same captures and predict the same rows, from pose and exposure time alone; where a
figure needs the paper's two models, e_k6 gives the brightness that q_k1 or q_k4 judges, and the
best of these stands beside ours. Figures are medians over the seeds. With the cell as it is, the
capture's image is the stripes' mean, so that ``i_avg`` is ``i_mean``: the paper's reading of one
stripe image is measured apart.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import models_few, models_learnt
from benchmarks.measuring import best_of, say
from benchmarks.models_campaigns import SEEDS, WORKERS, everything, skull
from benchmarks.models_scores import Figures, Measured
from exposight.models import train_window
from exposight.workers import LocalProcesses

Section = Callable[[int], Figures]

SECTIONS: Mapping[str, Section] = {
    "information": models_few.information,
    "learning_curves": models_few.learning_curves,
    "bare": models_learnt.bare,
    "few_captures": models_few.few_captures,
    "trials": models_few.trials,
    "variants": models_learnt.variants,
    "finishes": models_learnt.finishes,
    "other_surfaces": models_few.other_surfaces,
    "stereo": models_learnt.stereo,
}
"""The longest first."""


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What stands beside a figure.

    Parameters
    ----------
    prototype : str
        What a prototype of these models gave on an earlier simulated cell.
    most, least : float or None
        What the figure should not exceed, or reach.
    unit : str
    """

    prototype: str = ""
    most: float | None = None
    least: float | None = None
    unit: str = ""

    @property
    def mark(self) -> str:
        """The limit in words."""
        if self.most is not None:
            return f"≤ {self.most:g}"
        return "" if self.least is None else f"≥ {self.least:g}"

    def met(self, value: float) -> str:
        """Say whether a value keeps the limit."""
        if self.most is None and self.least is None:
            return ""
        kept = (self.most is None or value <= self.most) and (
            self.least is None or value >= self.least
        )
        return "met" if kept else "missed"


FIGURES: Mapping[str, Expected] = {
    "quality_rmse_percent": Expected(prototype="2.0", most=3, unit="%"),
    "quality_ratio_to_paper": Expected(prototype="0.10", most=0.2),
    "crps": Expected(prototype=".006", most=0.010),
    "band_width": Expected(prototype=".06", most=0.10),
    "coverage_2sigma": Expected(prototype="1.00", least=0.93),
    "coverage_2sigma_edge": Expected(prototype="1.00", least=0.93),
    "chance_brier": Expected(prototype=".005", most=0.010),
    "one_exposure_per_view_over_best": Expected(prototype="1.00", least=0.97),
    "primer": Expected(prototype="2.9", most=4, unit="%"),
    "paint": Expected(prototype="2.4", most=4, unit="%"),
    "brushed": Expected(prototype="3.4", most=5, unit="%"),
    "two_lobes": Expected(prototype="2.4", most=4, unit="%"),
    "foreign_surface": Expected(most=8, unit="%"),
    "foreign_surface_coverage": Expected(least=0.9),
    "no_physics": Expected(prototype="7.6", most=8.5, unit="%"),
    "projector_unknown": Expected(prototype="5.1", most=6, unit="%"),
    "projector_wrong": Expected(prototype="2.8", most=4, unit="%"),
    "kinematics": Expected(prototype="3.5", most=5, unit="%"),
    "one_image_only": Expected(prototype="8–13", most=13, unit="%"),
    "exposure_rmse_ms": Expected(prototype="1.6", most=3, unit="ms"),
    "exposure_median_relative": Expected(prototype=".009", most=0.015),
    "limits_error_percent": Expected(prototype="0.6", most=5, unit="%"),
    "five_captures": Expected(prototype="2.0–2.2", most=3, unit="%"),
    "primer_3": Expected(prototype="2.7–2.9", most=4, unit="%"),
    "paint_3": Expected(prototype="2.6–2.9", most=4, unit="%"),
    "brushed_10": Expected(prototype="4.0–5.2", most=6.5, unit="%"),
    "trial_capture_new_finish": Expected(prototype="1.1–1.4", most=2, unit="%"),
    "trial_never_worse": Expected(prototype="−0.1…+0.1", most=0.2, unit="points"),
    "false_surface_noticed": Expected(least=0.95),
    "stereo_quality_rmse_percent": Expected(prototype="10.6", most=12, unit="%"),
    "stereo_known": Expected(prototype="13.2", most=14, unit="%"),
    "stereo_ratio_to_paper": Expected(prototype="0.54", most=0.7),
    "skull_quality_rmse_percent": Expected(unit="%"),
    "skull_exposure_rmse_ms": Expected(unit="ms"),
    "fit_s": Expected(prototype="0.6", most=2, unit="CPU s"),
    "forecast_ms": Expected(most=2, unit="CPU ms"),
    "information_gain_captures": Expected(most=0.5),
}
"""The figures of the JSON object, in this order; all others are printed only."""


def carry_out(task: tuple[str, int]) -> Figures:
    """Carry out a section for a seed."""
    name, seed = task
    return SECTIONS[name](seed)


def medians(results: Sequence[Figures]) -> Figures:
    """Return the medians of figures over the seeds, in the order in which they came."""
    collected: dict[str, list[Measured]] = defaultdict(list)
    for figures in results:
        for name, figure in figures.items():
            collected[name].append(figure)
    return {
        name: Measured(
            value=float(np.median([each.value for each in many])),
            coverage=_median([each.coverage for each in many]),
            paper=_median([each.paper for each in many]),
        )
        for name, many in collected.items()
    }


def _median(values: Sequence[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return float(np.median(there)) if there else None


def speed() -> Figures:
    """Time training on bare sheet's campaign, and the forecast of 30 features at 200 times."""
    both = models_learnt.observed("bare", SEEDS[0])
    sensor = models_learnt.condition("bare").sensor
    fit = best_of(2, partial(train_window, both.train, sensor=sensor))
    model = models_learnt.learnt("bare", SEEDS[0])
    rings = both.test.frame.unique(["view", "feature"], maintain_order=True)[:30]
    times_ms = np.geomspace(3.0, 500.0, 200).tolist()

    def forecast() -> object:
        result = model.forecast(rings, times_ms)
        return result.p_norm, result.low, result.high, result.chance

    return {
        "fit_s": Measured(value=fit.cpu_s),
        "forecast_ms": Measured(value=1000.0 * best_of(50, forecast).cpu_s),
    }


def show(title: str, figures: Figures) -> None:
    """Print figures beside what is expected."""
    table = Table(title=title)
    table.add_column("figure")
    for name in ("value", "2σ", "paper", "prototype", "limit", ""):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for name, figure in figures.items():
        expected = FIGURES.get(name, Expected())
        numbers = (
            "–" if each is None else f"{each:.3g}" for each in (figure.coverage, figure.paper)
        )
        table.add_row(
            name,
            f"{figure.value:.3g}",
            *numbers,
            expected.prototype,
            expected.mark,
            expected.met(figure.value),
            expected.unit,
        )
    Console(width=120).print(table)


def main() -> None:
    """Measure and train what is not kept, carry out all sections, print tables and the JSON."""
    for _ in everything():
        pass
    skull()
    say("training the paper's models")
    models_learnt.train_papers(SEEDS, WORKERS)
    say("timing")
    results = [speed()]
    tasks = [(name, seed) for name in SECTIONS for seed in SEEDS]
    with closing(LocalProcesses(WORKERS).run(carry_out, tasks)) as running:
        for (name, seed), figures in running:
            say(f"{name}, seed {seed}: done")
            results.append(figures)
    say("the recorded skull")
    results.append(models_learnt.recorded_skull(SEEDS[0]))
    figures = medians(results)
    show("further figures", {k: v for k, v in figures.items() if k not in FIGURES})
    wanted = {name: figures[name] for name in FIGURES if name in figures}
    show("models, medians of three seeds, in new views", wanted)
    print(json.dumps({k: figures[k].value if k in figures else None for k in FIGURES}), flush=True)


if __name__ == "__main__":
    main()

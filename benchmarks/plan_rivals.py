"""Open and closed loop beside their rivals and the paper's models, on sweeps of unseen views.

Strategies without models choose their constants in hindsight on the views that are compared. The
oracle knows every outcome; exposures are captures and trial images together, over its captures.
Allowed exposure times are the sweep's own 33 whole milliseconds. Figures are medians of three
seeds; of several lamps or finishes the worst one's.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.measuring import Figure, at_least, at_most, publish, say
from benchmarks.models_campaigns import COMET, SEEDS, WORKERS
from benchmarks.models_learnt import papers
from benchmarks.plan_campaigns import SWEEPS, sweep_of, training_table
from exposight.planning import Comparison, SensorModels, Sweep, compare, train
from exposight.planning.comparing.strategies import STRATEGIES
from exposight.workers import LocalProcesses

LAMPS = ("lamp_dim", "lamp_bright")
FINISHES = ("primer", "paint", "brushed", "two_lobes", "foreign_surface")
_LOOPS = ("open_loop", "closed_loop")
PAPER, NO_MEAN = " (q_k4 + e_k6)", " (2)"
"""How strategies with the paper's two models, and with no physical mean, are told apart."""

Score = Mapping[str, Any]


def compared(task: tuple[str, int]) -> Comparison:
    """Compare strategies on one sweep; all of them, and all models, where all is as learnt."""
    name, seed = task
    sweep = next(each for each in SWEEPS if each.name == name)
    outcomes = Sweep.of(sweep_of(sweep, seed), name=f"{name}-{seed}", sensor=COMET)
    table = training_table(seed)
    ours = train(table, sensor=COMET)
    if name != "bare":
        return compare(outcomes, _LOOPS, models=[ours])
    kept = papers("bare", seed).models
    chain = SensorModels(quality=kept["q_k4"], exposure=kept["e_k6"])
    no_mean = train(table, sensor=COMET, mean="none")
    rivals = compare(outcomes, STRATEGIES, models=[chain])
    with_models = compare(outcomes, _LOOPS, models=[ours, no_mean])
    return with_models.with_others(rivals)


def comparisons(seeds: tuple[int, ...] = SEEDS) -> dict[tuple[str, int], Comparison]:
    """Compare on all sweeps, by name and seed."""
    tasks = [(each.name, seed) for each in SWEEPS for seed in seeds]
    out = {}
    with closing(LocalProcesses(WORKERS).run(compared, tasks)) as running:
        for (name, seed), comparison in running:
            say(f"{name}, seed {seed}: {comparison.verdict}")
            out[name, seed] = comparison
    return out


def scores_of(done: Mapping[tuple[str, int], Comparison]) -> dict[tuple[str, str], Score]:
    """Return the medians over seeds of each sweep's and strategy's scores."""
    rows: dict[tuple[str, str], list[Score]] = {}
    for (name, _), comparison in sorted(done.items()):
        for row in comparison.scores.to_dicts():
            rows.setdefault((name, row["strategy"]), []).append(row)
    return {key: _medians(several) for key, several in rows.items()}


def _medians(rows: list[Score]) -> Score:
    numbers = {
        name: [row[name] for row in rows if row[name] is not None]
        for name, value in rows[0].items()
        if not isinstance(value, str)
    }
    medians = {name: float(np.median(each)) if each else None for name, each in numbers.items()}
    return {**rows[0], **medians}


def best_rival(scores: Mapping[tuple[str, str], Score]) -> Score:
    """Return the rival with the fewest exposures of those that cover 99 % of the features."""
    rivals = [row for (name, _), row in scores.items() if name == "bare" and row["kind"] == "rival"]
    good = [row for row in rivals if row["covered_share"] >= 0.99]
    return min(good or rivals, key=lambda row: (-bool(good), row["exposures_over_oracle"]))


def show(scores: Mapping[tuple[str, str], Score]) -> None:
    """Print all scores."""
    table = Table(title="strategies, medians of seeds; constants of rivals in hindsight")
    for name in ("sweep", "strategy"):
        table.add_column(name)
    columns = (
        "covered_share", "exposures", "trial_images", "exposures_over_oracle", "time_s",
        "all_had_share", "promised", "achieved", "promise_brier", "chance_brier",
    )  # fmt: skip
    for name in columns:
        table.add_column(name.replace("_", "\n"), justify="right")
    for (sweep, name), row in scores.items():
        values = ("–" if row[each] is None else f"{row[each]:.3f}" for each in columns)
        table.add_row(sweep, name, *values)
    Console(width=150).print(table)


def figures() -> list[Figure]:
    """Compare, print the scores, and return the figures."""
    scores = scores_of(comparisons())
    show(scores)
    opened, closed = scores["bare", "open_loop (1)"], scores["bare", "closed_loop (1)"]
    rival, paper = best_rival(scores), scores["bare", "open_loop" + PAPER]
    no_mean = scores["bare", "open_loop" + NO_MEAN]
    lamps = [scores[name, "closed_loop"] for name in LAMPS]
    finishes = [scores[name, "closed_loop"] for name in FINISHES]
    say(f"best rival: {rival['strategy']}")
    return [
        at_least("covered_share", opened["covered_share"], 0.99),
        at_most("exposures_over_oracle", opened["exposures_over_oracle"], 1.12),
        at_least("loop_covered_share", closed["covered_share"], 1.0),
        at_most("loop_exposures_over_oracle", closed["exposures_over_oracle"], 1.06),
        at_least("loop_drift_covered_share", _worst(lamps, "covered_share", least=True), 0.995),
        at_most("loop_drift_exposures_over_oracle", _worst(lamps, "exposures_over_oracle"), 1.10),
        at_least("loop_finish_covered_share", _worst(finishes, "covered_share", least=True), 0.97),
        _figure("loop_finish_exposures_over_oracle", _worst(finishes, "exposures_over_oracle")),
        _figure("best_rival_exposures_over_oracle", rival["exposures_over_oracle"]),
        _figure("best_rival_covered_share", rival["covered_share"]),
        _figure("paper_covered_share", paper["covered_share"]),
        _figure("paper_exposures_over_oracle", paper["exposures_over_oracle"]),
        _within("promised_minus_achieved", _excess(opened), 0.03),
        at_most("brier", opened["chance_brier"], 0.05),
        _figure("paper_promised_minus_achieved", _excess(paper)),
        _figure("paper_brier", paper["chance_brier"]),
        _figure("no_mean_covered_share", no_mean["covered_share"]),
        _figure("no_mean_exposures_over_oracle", no_mean["exposures_over_oracle"]),
        _within("no_mean_promised_minus_achieved", _excess(no_mean), 0.03),
        at_most("no_mean_brier", no_mean["chance_brier"], 0.05),
    ]


def _worst(rows: list[Score], name: str, *, least: bool = False) -> float:
    values = [float(row[name]) for row in rows]
    return min(values) if least else max(values)


def _excess(row: Score) -> float:
    return float(row["promised"] - row["achieved"])


def _within(name: str, value: float, limit: float) -> Figure:
    return Figure(name=name, value=value, mark=f"± {limit:g}", met=abs(value) <= limit)


def _figure(name: str, value: float) -> Figure:
    return Figure(name=name, value=value)


if __name__ == "__main__":
    publish("strategies on unseen views", figures())

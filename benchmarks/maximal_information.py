"""The maximal information coefficient: agreement with reference values, and time."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import get_args

import numpy as np

from benchmarks.measuring import Figure, at_most, best_of, say
from exposight.statistics import characteristic_matrix
from exposight.statistics.mic import Estimator

_REFERENCE_VARIABLE = "EXPOSIGHT_REFERENCE_DATA"
_OBSERVATIONS = 912
"""Training observations of the paper's quality model, Sect. 3.2.2."""
_RUNS = 20


def mic_figures() -> list[Figure]:
    """Return the largest error over all reference values, and CPU times on 912 observations.

    The error is None where the reference values are not found, in the folder that
    EXPOSIGHT_REFERENCE_DATA names or beside the repository.
    """
    say("the maximal information coefficient")
    # Independent variables take longest: the other axis falls into the most clumps.
    x, y = np.random.default_rng(0).normal(size=(2, _OBSERVATIONS))

    def cpu_ms(estimator: Estimator) -> float:
        def coefficient() -> float:
            return float(characteristic_matrix(x, y, estimator=estimator).max())

        return 1e3 * best_of(_RUNS, coefficient).cpu_s

    return [
        _error_figure(),
        at_most("mic_912_ms", cpu_ms("approx"), 100.0, "ms CPU"),
        Figure(name="mic_e_912_ms", value=cpu_ms("e"), unit="ms CPU"),
    ]


def _error_figure() -> Figure:
    beside = Path(__file__).resolve().parents[2] / "shared" / "data" / "reference"
    folder = Path(os.environ.get(_REFERENCE_VARIABLE, beside)) / "mic"
    if not folder.is_dir():
        say(f"the reference values were not found: set {_REFERENCE_VARIABLE} to their folder")
        return Figure(name="mic_max_error", value=None, mark="≤ 1e-06")
    return at_most("mic_max_error", max(_vector_errors(folder) + _shape_errors(folder)), 1e-6)


def _vector_errors(folder: Path) -> list[float]:
    vectors = json.loads((folder / "small_vectors.json").read_text())
    return [
        abs(
            characteristic_matrix(
                vector["x"], vector["y"], alpha=vector["alpha"], c=vector["c"], estimator=estimator
            ).max()
            - vector[f"mic_{estimator}"]
        )
        for vector in vectors
        for estimator in get_args(Estimator)
    ]


def _shape_errors(folder: Path) -> list[float]:
    points = np.genfromtxt(folder / "datasaurus_xy.csv", delimiter=",", names=True)
    with (folder / "datasaurus_mine_values.csv").open() as file:
        rows = list(csv.DictReader(file))
    estimator_of = {f"mic_{estimator}": estimator for estimator in get_args(Estimator)}
    return [
        abs(
            characteristic_matrix(
                points[f"{row['pair']}_x"],
                points[f"{row['pair']}_y"],
                alpha=float(row["alpha"]),
                c=float(row["c"]),
                estimator=estimator_of[row["estimator"]],
            ).max()
            - float(row["MIC"])
        )
        for row in rows
    ]

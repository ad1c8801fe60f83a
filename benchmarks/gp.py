"""Gaussian processes: ours, GPy, scikit-learn and GPyTorch side by side, on one thread.

Run with ``make bench NAME=gp``; about ten minutes. Times are CPU seconds, the engines take turns,
and of several runs the quickest counts. GPyTorch is measured where it is installed
(``pip install torch gpytorch``).
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas

from benchmarks.gp_more_data import more_data
from benchmarks.gp_peers import (
    Engine,
    Exposight,
    GPy,
    GPyTorch,
    Problem,
    ScikitLearn,
    exposure_problem,
    gpytorch_installed,
    quality_problem,
)
from benchmarks.maximal_information import mic_figures
from benchmarks.measuring import Figure, at_least, at_most, publish, say
from exposight.gp import GaussianProcess
from exposight.gp.tiling import limit_blas

_ROUNDS = 7
# Where L-BFGS stops; likelihoods nearer to each other count as equal.
_SAME_LIKELIHOOD = 0.01


def cpu_seconds(call: Callable[[], object]) -> float:
    """Run once and return the CPU seconds of all threads."""
    began = time.process_time()
    call()
    return time.process_time() - began


def quickest_in_turns(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Run several calls in turns, after one warm-up of each; CPU seconds of each one's best."""
    for call in calls:
        call()
    rounds = [[cpu_seconds(call) for call in calls] for _ in range(_ROUNDS)]
    return [min(times) for times in zip(*rounds, strict=True)]


def evaluations(problem: Problem, engines: Sequence[Engine]) -> list[Figure]:
    """Time one likelihood with gradient, each engine at points it has not seen just before."""
    truth = np.append(problem.kernel.log_parameters, np.log(problem.noise_variance))
    points = iter(truth + 1e-3 * np.random.default_rng(3).standard_normal((1000, len(truth))))
    values = [engine.evaluate(truth) for engine in engines]
    for engine, value in zip(engines, values, strict=True):
        say(f"  {engine.name}: log likelihood {value:.6f}")
        if abs(value - values[0]) > _SAME_LIKELIHOOD:
            msg = f"{engine.name} computes another likelihood than {engines[0].name}"
            raise RuntimeError(msg)
    calls = [_evaluation(engine, points) for engine in engines]
    rate_s, *times = quickest_in_turns([_matrix_product(len(problem.x)), *calls])
    for engine, own in zip(engines, times, strict=True):
        say(f"  {engine.name}: {1e3 * own:.1f} ms")
    floor_s = 0.5 * rate_s  # a product takes 2 N³ operations, an evaluation N³
    name, ours = problem.name, times[0]
    figures = [
        Figure(name=f"dgemm_{name}", value=1e-9 * len(problem.x) ** 3 / floor_s, unit="Gflop/s"),
        Figure(name=f"eval_ms_{name}", value=1e3 * ours, unit="ms"),
        at_least(f"limit_fraction_{name}", floor_s / ours, 0.55)
        if name == "e"
        else Figure(name=f"limit_fraction_{name}", value=floor_s / ours),
    ]
    marks = {"GPy": ("gpy", 3.0), "scikit-learn": ("sklearn", 5.0), "GPyTorch": ("gpytorch", 3.8)}
    for engine, own in zip(engines[1:], times[1:], strict=True):
        short, mark = marks[engine.name]
        figures.append(at_least(f"eval_ratio_{short}_{name}", own / ours, mark))
    return figures


def _evaluation(engine: Engine, points: Iterator[NDArray[np.float64]]) -> Callable[[], object]:
    return lambda: engine.evaluate(next(points))


def _matrix_product(rows: int) -> Callable[[], object]:
    """Return a product of two matrices, the machine's quickest arithmetic."""
    matrix = np.asfortranarray(np.random.default_rng(0).standard_normal((rows, rows)))
    out = np.empty_like(matrix, order="F")
    return lambda: blas.dgemm(1.0, matrix, matrix, c=out, overwrite_c=1)


def fits(problem: Problem, ours: Exposight, theirs: GPy) -> list[Figure]:
    """Fit from three starts, GPy from the same ones."""
    took_s, ends = [], []
    for engine in (ours, theirs):
        began = time.process_time()
        found = [engine.fit(start) for start in problem.starts]
        took_s.append(time.process_time() - began)
        ends.append(max(found))
        listed = ", ".join(f"{own:.4f}" for own in found)
        say(f"  {engine.name}: {took_s[-1]:.2f} s, {engine.evaluations} evaluations, {listed}")
    name = problem.name
    gain = ends[0] - ends[1]
    return [
        at_least(f"fit_ratio_gpy_{name}", took_s[1] / took_s[0], 8.0),
        Figure(name=f"fit_s_{name}", value=took_s[0], unit="s"),
        Figure(
            name=f"fit_gain_{name}",
            value=gain,
            unit="nats over GPy",
            mark=f"≥ −{_SAME_LIKELIHOOD:g}",
            met=gain >= -_SAME_LIKELIHOOD,
        ),
    ]


def predictions(problems: Sequence[Problem], marks_ms: Sequence[float]) -> list[Figure]:
    """Predict 100 points with variances on one thread."""
    figures = []
    for problem, mark in zip(problems, marks_ms, strict=True):
        process = GaussianProcess.condition(
            problem.kernel, problem.noise_variance, problem.x, problem.y
        )
        predict = partial(process.predict, problem.new, threads=1)
        (own_s,) = quickest_in_turns([predict])
        figures.append(at_most(f"predict_100_ms_{problem.name}", 1e3 * own_s, mark, "ms"))
    return figures


def large() -> list[Figure]:
    """Evaluate 13 466 observations once, in a fresh process."""
    say("13 466 observations, one evaluation")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.gp_large"], check=True, capture_output=True, text=True
    )
    result = json.loads(done.stdout.splitlines()[-1])
    return [
        at_most("eval_13466_s", result["cpu_s"], 45.0, "s"),
        Figure(name="eval_13466_gb", value=None, unit="GB", mark="≤ 2")
        if result["peak_gb"] is None
        else at_most("eval_13466_gb", result["peak_gb"], 2.0, "GB"),
    ]


def main() -> None:
    """Run everything on one thread."""
    figures: list[Figure] = []
    problems = (quality_problem(), exposure_problem())
    with limit_blas(1):
        for problem in problems:
            rows, columns = problem.x.shape
            say(f"{problem.name.upper()}: {rows} observations of {columns} inputs")
            ours, gpy = Exposight(problem), GPy(problem)
            engines: list[Engine] = [ours, gpy]
            if problem.name == "e":
                engines.append(ScikitLearn(problem))
                if gpytorch_installed():
                    engines.append(GPyTorch(problem))
            figures += evaluations(problem, engines)
            if problem.name == "e" and not gpytorch_installed():
                say("  GPyTorch is not installed and stays out")
                figures.append(Figure(name="eval_ratio_gpytorch_e", value=None, mark="≥ 3.8"))
            figures += fits(problem, ours, gpy)
        figures += predictions(problems, (3.0, 12.0))
    figures += large()
    figures += more_data() + mic_figures()
    publish("Gaussian processes", figures)


if __name__ == "__main__":
    main()

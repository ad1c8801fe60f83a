"""Cover programs of many views, held against every choice of captures that there is."""

import math
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import sparse

from exposight.planning.covering.cover_budget import greedy_choices, most_within
from exposight.planning.covering.cover_program import Program, useful_settings
from exposight.planning.covering.cover_search import search
from exposight.planning.covering.cover_solver import cheapest_cover
from exposight.planning.covering.highs_process import HighsProcess, solve_arrays

FEW = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@st.composite
def programs(draw, grouped=True):
    """Up to 6 features and 10 captures of 3 views; a group of two captures in some."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, per_view, views = draw(st.integers(1, 6)), draw(st.integers(1, 3)), 3
    c = per_view * views
    covers = (rng.random((n, c)) < draw(st.sampled_from([0.2, 0.4, 0.6]))).astype(float)
    groups = ()
    if grouped and per_view > 1 and draw(st.booleans()):
        groups = ((0, 1),)
        covers = np.column_stack([covers, rng.random(n) < 0.5])
    covers[~covers.any(axis=1), rng.integers(c)] = 1.0  # each can be served
    counts = draw(st.booleans())
    return Program(
        covers=sparse.csc_array(covers),
        view=np.array([*np.repeat(np.arange(views), per_view), *[0 for _ in groups]]),
        cost=np.ones(c) if counts else rng.integers(1, 20, c).astype(float),
        move=np.zeros(views) if counts else rng.integers(0, 30) * np.ones(views),
        groups=groups,
        least=draw(st.sampled_from([1, 1, 2])) if per_view > 1 else 1,
        most=draw(st.sampled_from([None, None, 2])),
    )


def all_choices(program):
    for bits in product((False, True), repeat=program.n_captures):
        taken = np.array(bits)
        if program.keeps_limits(taken):
            yield taken


@FEW
@given(programs())
def test_the_cheapest_cover_is_that_of_all_choices(program):
    costs = [program.value(x) for x in all_choices(program) if program.served(x).all()]
    cover = cheapest_cover(program)
    if not costs:
        assert cover is None
        return
    assert cover.objective == pytest.approx(min(costs), rel=2e-4)
    assert cover.lower_bound <= cover.objective + 1e-9
    assert cover.gap <= 2e-4
    assert program.served(cover.taken).all()
    assert program.keeps_limits(cover.taken)
    assert cover.objective == program.value(cover.taken)


@FEW
@given(programs(), st.floats(1.0, 60.0))
def test_most_features_within_a_budget_are_those_of_all_choices(program, budget):
    ones = np.ones(program.covers.shape[0])
    best = max(
        int(program.served(x).sum()) for x in all_choices(program) if program.value(x) <= budget
    )
    choice = most_within(program, ones, budget)
    assert choice.worth == choice.bound == best
    if choice.tangent is not None:
        at, at_most, slope = choice.tangent
        for x in all_choices(program):  # also beyond the budget
            line = at_most + slope * (program.value(x) - at)
            assert program.served(x).sum() <= line + 1e-6
    assert program.value(choice.taken) <= budget + 1e-6
    assert program.keeps_limits(choice.taken)


@FEW
@given(programs())
def test_greedy_choices_cost_more_and_serve_more_at_every_step(program):
    weights = np.ones(program.covers.shape[0])
    steps = greedy_choices(program, weights, budget=25.0)
    values = [program.value(each) for each in steps]
    served = [program.served(each).sum() for each in steps]
    assert values == sorted(values)
    assert values[-1] <= 25.0 + 1e-9
    assert all(a < b for a, b in pairwise(served))


@FEW
@given(programs(grouped=False))
def test_components_and_implied_features_change_nothing(program):
    program = replace(program, least=1, most=None)
    apart = sum(
        cheapest_cover(program.part(rows, captures)).objective
        for rows, captures in program.components()
    )
    whole = cheapest_cover(program).objective
    assert apart == pytest.approx(whole, rel=2e-4)
    assert cheapest_cover(program.without_implied()).objective == pytest.approx(whole, rel=2e-4)


@FEW
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_settings_that_are_left_out_are_never_needed(seed, counts):
    rng = np.random.default_rng(seed)
    serves = rng.random((5, 12)) < 0.4
    cost = np.ones(12) if counts else np.arange(1.0, 13.0)
    kept = useful_settings(serves, cost)
    for each in set(range(12)) - set(kept.tolist()):
        other = [
            k for k in kept if cost[k] <= cost[each] and not (serves[:, each] & ~serves[:, k]).any()
        ]
        assert other or not serves[:, each].any()
    assert {1} <= set(useful_settings(serves, cost, keep=[1]).tolist())


def sheet(n=60, views=12, seed=3):
    rng = np.random.default_rng(seed)
    m = 8
    covers = (rng.random((n, views * m)) < 0.12).astype(float)
    covers[~covers.any(axis=1), 0] = 1.0
    return Program(
        covers=sparse.csc_array(covers),
        view=np.repeat(np.arange(views), m),
        cost=np.tile(np.arange(1.0, m + 1.0), views),
        move=np.full(views, 5.0),
    )


def test_a_solver_without_time_gives_its_best_plan_and_the_gap():
    program = sheet()
    hasty = cheapest_cover(program, limit_s=0.01)
    patient = cheapest_cover(program, limit_s=20.0)
    assert program.served(hasty.taken).all()
    assert hasty.lower_bound <= patient.objective + 1e-9
    assert patient.lower_bound <= patient.objective <= hasty.objective + 1e-9
    assert patient.gap <= hasty.gap + 1e-9


def test_the_search_finds_covers_near_the_bound_and_keeps_a_view_s_most_captures():
    program = sheet()
    taken = search(program, rounds=2, limit_s=30.0)
    optimum = cheapest_cover(program, limit_s=20.0)
    assert program.value(taken) <= 1.1 * optimum.objective
    limited = search(replace(program, most=1), rounds=1, limit_s=30.0)
    assert limited is None or program.counts(limited).max() == 1


def test_another_process_answers_as_this_one_does():
    linear = sheet(n=20, views=4).linear()
    request = {
        "objective": linear.objective,
        "data": linear.matrix.data,
        "indices": linear.matrix.indices,
        "indptr": linear.matrix.indptr,
        "low": linear.low,
        "upper": linear.upper,
        "whole": linear.whole,
        "relaxed": True,
        "gap": 1e-4,
        "limit_s": 20.0,
    }
    process = HighsProcess()
    try:
        relaxed = process.start(request)
        whole = process.start({**request, "relaxed": False})
        bound = relaxed.result(timeout=60.0)["bound"]
        assert bound == pytest.approx(solve_arrays(request)["bound"])
        assert whole.result(timeout=60.0)["bound"] >= bound - 1e-9
        impossible = {**request, "low": linear.low + 1e3}
        assert process.start(impossible).result(timeout=60.0)["bound"] == math.inf
    finally:
        process.close()


_LONG = """
import numpy as np
from scipy import sparse
from exposight.planning.covering.cover_program import Program
from exposight.planning.covering.cover_solver import cheapest_cover

rng = np.random.default_rng(1)
covers = (rng.random((300, 40 * 30)) < 0.05).astype(float)
covers[~covers.any(axis=1), 0] = 1.0
program = Program(
    covers=sparse.csc_array(covers),
    view=np.repeat(np.arange(40), 30),
    cost=np.tile(np.linspace(1.0, 4.0, 30), 40),
    move=np.full(40, 5.0),
)
print("begun", flush=True)
cheapest_cover(program, limit_s=120.0)
"""


@pytest.mark.slow
def test_ctrl_c_ends_the_solver_and_its_process_at_once():
    process = subprocess.Popen([sys.executable, "-c", _LONG], stdout=-1, stderr=-1, text=True)
    assert process.stdout.readline() == "begun\n"
    time.sleep(5.0)  # scipy works in the other process by then, and would not hear of it here
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    solvers = children.read_text().split() if children.exists() else []
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20.0)
    assert "KeyboardInterrupt" in errors
    assert not any(Path(f"/proc/{each}").exists() for each in solvers)

"""How fast, and how near the optimum, the exposures of many views are planned.

Parts are made up: holes on a gently curved sheet, a camera 600 mm before it with a projector beside
it, and a glossy lobe about the half vector, which decides from where a hole is bright. So exposure
times of neighbours are alike, as on the door. What is solved is
`exposight.planning.covering.cover_solver`, after the exact reduction; HiGHS alone is the peer.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy import sparse
from scipy.special import ndtr

from benchmarks.measuring import Figure, at_most, say
from exposight.planning.covering.cover_program import Program, useful_settings
from exposight.planning.covering.cover_search import search
from exposight.planning.covering.cover_solver import Cover, cheapest_cover

BoolArray: TypeAlias = NDArray[np.bool_]
FloatArray: TypeAlias = NDArray[np.float64]

FEATURES, VIEWS, TIMES = 500, 60, 200
SEEDS = (1, 2, 3)
SIGMA, CONFIDENCE = 0.1, 0.9
FRAMES, OVERHEAD_MS, MOVE_MS = 12, 500.0, 3000.0

SHEETS_MM = {
    "sparse": (3000.0, 1500.0),
    "medium": (2000.0, 1200.0),
    "uneven": (2000.0, 1200.0),
    "dense": (1400.0, 900.0),
}
"""The same number of holes and views on smaller sheets: a hole is seen from more of them."""

_DISTANCE_MM, _BASE_MM, _FIELD_MM = 600.0, 250.0, (590.0, 390.0)
"""Of the COMET (Table 7 of the paper), its base rounded."""

_GLOSS, _LOBE = 12.0, 0.15
"""Brightness at the lobe's top over that beside it, and its width, a slope; assumed."""

_BESIDE, _UNEVEN = 0.1, 0.3
"""Standard deviation of ln brightness from hole to hole; assumed. Uneven parts are harder."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """Which holes each view's captures serve, and how many views see a hole on average."""

    serves: BoolArray  # (n, v, m)
    times_ms: FloatArray
    density: float


def sheet(size_mm: tuple[float, float], seed: int, beside: float = _BESIDE) -> Sheet:
    """Make up a part and its views."""
    rng = np.random.default_rng(seed)
    holes = rng.uniform(0.0, 1.0, (FEATURES, 2)) * size_mm
    slopes = np.zeros((FEATURES, 2))
    for _ in range(3):  # waves of the sheet
        towards = rng.normal(size=2)
        towards /= np.linalg.norm(towards)
        wave, phase = rng.uniform(600.0, 1500.0), rng.uniform(0.0, 2.0 * np.pi)
        height = np.tan(np.radians(rng.uniform(3.0, 8.0)))
        slopes += height * np.cos(holes @ towards * 2.0 * np.pi / wave + phase)[:, None] * towards
    middles = rng.uniform(0.0, 1.0, (VIEWS, 2)) * size_mm
    tilts = np.radians(rng.uniform(-20.0, 20.0, (VIEWS, 2)))
    turns = rng.uniform(0.0, 2.0 * np.pi, VIEWS)
    across = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    up = np.stack([-across[:, 1], across[:, 0]], axis=1)
    feet = middles - _DISTANCE_MM * np.tan(tilts)
    offsets = holes[:, None] - middles
    seen = (np.abs((offsets * across).sum(-1)) < _FIELD_MM[0] / 2.0) & (
        np.abs((offsets * up).sum(-1)) < _FIELD_MM[1] / 2.0
    )
    normals = np.column_stack([-slopes, np.ones(FEATURES)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def directions(places: FloatArray) -> tuple[FloatArray, FloatArray]:
        rays = np.dstack([places[None] - holes[:, None], np.full((FEATURES, VIEWS), _DISTANCE_MM)])
        lengths = np.linalg.norm(rays, axis=-1)
        return rays / lengths[..., None], lengths

    to_camera, _ = directions(feet)
    to_projector, far = directions(feet + _BASE_MM * across)
    half = to_camera + to_projector
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    lit = (to_projector * normals[:, None]).sum(-1).clip(0.05)
    off = 1.0 / (half * normals[:, None]).sum(-1).clip(0.05, 1.0) ** 2 - 1.0
    brightness = np.log(lit * (1.0 + _GLOSS * np.exp(-off / (2.0 * _LOBE**2))))
    brightness -= 2.0 * np.log(far / _DISTANCE_MM)
    middle = np.log(110.0) - brightness + rng.normal(0.0, beside, (FEATURES, 1))
    middle += rng.normal(0.0, 0.05, (FEATURES, VIEWS))
    width = rng.normal(1.45, 0.1, (FEATURES, 1))  # ln: planning for p_norm of 0.75
    times_ms = np.asarray(np.geomspace(2.0, 700.0, TIMES), dtype=np.float64)
    log_ms = np.log(times_ms)
    chance = ndtr((log_ms - (middle - width / 2.0)[..., None]) / SIGMA)
    chance -= ndtr((log_ms - (middle + width / 2.0)[..., None]) / SIGMA)
    serves = (chance >= CONFIDENCE) & seen[..., None]
    return Sheet(serves=serves, times_ms=times_ms, density=float(seen.sum(axis=1).mean()))


def program_of(part: Sheet, goal: str) -> Program:
    """Return the reduced program of a part; costs are captures or seconds."""
    by_time = goal == "time"
    cost = (FRAMES * part.times_ms + OVERHEAD_MS) / 1000.0 if by_time else np.ones(TIMES)
    kept = [useful_settings(part.serves[:, v], cost) for v in range(VIEWS)]
    serves = np.concatenate([part.serves[:, v][:, each] for v, each in enumerate(kept)], axis=1)
    return Program(
        covers=sparse.csc_array(serves[serves.any(axis=1)].astype(np.float64)),
        view=np.repeat(np.arange(VIEWS), list(map(len, kept))),
        cost=np.concatenate([cost[each] for each in kept]),
        move=np.full(VIEWS, MOVE_MS / 1000.0 if by_time else 0.0),
    )


@dataclass(frozen=True, kw_only=True)
class Run:
    """What solving one part gave."""

    size: str
    goal: str
    peer: bool
    density: float
    cover: Cover | None
    cpu_s: float
    wall_s: float


def _cpu_s() -> float:
    """Return CPU seconds of this process and of those that it waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def solved(size: str, goal: str, limit_s: float, *, peer: bool = False) -> list[Run]:
    """Solve the parts of all seeds; by HiGHS without a cover to start from, as the peer."""
    runs = []
    for seed in SEEDS:
        part = sheet(SHEETS_MM[size], seed, _UNEVEN if size == "uneven" else _BESIDE)
        cpu, wall = _cpu_s(), time.perf_counter()
        program = program_of(part, goal)
        cover = cheapest_cover(program, limit_s=limit_s, incumbent=not peer)
        runs.append(
            Run(
                size=size,
                goal=goal,
                peer=peer,
                density=part.density,
                cover=cover,
                cpu_s=_cpu_s() - cpu,
                wall_s=time.perf_counter() - wall,
            )
        )
    return runs


def _first_plan_s() -> float:
    """Return CPU seconds until a dense part has its first whole plan, the median of the seeds."""
    spent = []
    for seed in SEEDS:
        part = sheet(SHEETS_MM["dense"], seed)
        cpu = time.process_time()
        program = program_of(part, "time").without_implied()
        taken = search(program, rounds=1, limit_s=60.0, seed=seed)
        assert taken is not None
        assert program.served(taken).all()
        spent.append(time.process_time() - cpu)
    return median(spent)


def _shown(runs: list[Run]) -> Table:
    table = Table(title=f"{FEATURES} features, {VIEWS} views, {TIMES} times; medians of 3 seeds")
    for heading in ("part", "views a feature", "goal", "by", "cost", "bound", "gap", "CPU s", "s"):
        table.add_column(heading, justify="left" if heading in {"part", "goal", "by"} else "right")
    groups: dict[tuple[str, str, bool], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.size, run.goal, run.peer), []).append(run)
    for (size, goal, peer), each in groups.items():
        covers = [run.cover for run in each]

        def middle(value: Callable[[Cover], float], covers: list[Cover | None] = covers) -> str:
            if None in covers:
                return "no plan"
            return f"{median(value(cover) for cover in covers if cover is not None):.4g}"

        table.add_row(
            size,
            f"{np.mean([run.density for run in each]):.1f}",
            goal,
            "HiGHS alone" if peer else "exposight",
            middle(lambda cover: cover.objective),
            middle(lambda cover: cover.lower_bound),
            middle(lambda cover: cover.gap),
            f"{median(run.cpu_s for run in each):.2f}",
            f"{median(run.wall_s for run in each):.2f}",
        )
    return table


def solver_figures(*, peers: bool = True) -> list[Figure]:
    """Solve parts of three densities, print what came of it, and return the figures.

    Parameters
    ----------
    peers : bool
        Whether HiGHS alone solves them, too.
    """
    solved_before = sheet((900.0, 600.0), 9)  # compiles, and imports what is imported once
    search(program_of(solved_before, "time"), rounds=1, limit_s=0.0)
    wanted = (
        ("sparse", "count", 10.0),
        ("medium", "count", 10.0),
        ("medium", "time", 10.0),
        ("uneven", "count", 10.0),
        ("dense", "count", 20.0),
        ("dense", "time", 20.0),
    )
    runs: list[Run] = []
    for size, goal, limit_s in wanted:
        say(f"planning: {size} parts, {goal}")
        runs += solved(size, goal, limit_s)
        if peers and size in {"sparse", "medium"}:
            runs += solved(size, goal, limit_s, peer=True)
    Console(width=110).print(_shown(runs))

    def middle(size: str, goal: str, value: Callable[[Run, Cover], float]) -> float:
        ours = [run for run in runs if (run.size, run.goal, run.peer) == (size, goal, False)]
        return median(value(run, run.cover) for run in ours if run.cover is not None)

    sparse_runs = [run for run in runs if run.size == "sparse" and not run.peer]
    proven = all(run.cover is not None and run.cover.gap == 0.0 for run in sparse_runs)
    sparse_s = middle("sparse", "count", lambda run, _: run.cpu_s)
    return [
        Figure(
            name="plan_sparse_s",
            value=sparse_s,
            unit="CPU s, proven optimal" if proven else "CPU s, not proven",
            mark="≤ 5, proven",
            met=proven and sparse_s <= 5.0,
        ),
        at_most(
            "plan_medium_count_gap",
            middle("medium", "count", lambda _, cover: cover.objective - cover.lower_bound),
            1.0,
            "exposures, within 10 s",
        ),
        Figure(
            name="plan_uneven_count_gap",
            value=middle("uneven", "count", lambda _, cover: cover.objective - cover.lower_bound),
            unit="exposures, within 10 s",
        ),
        at_most(
            "plan_time_gap", middle("medium", "time", lambda _, cover: cover.gap), 0.03, "in 10 s"
        ),
        Figure(
            name="plan_dense_gap",
            value=middle("dense", "time", lambda _, cover: cover.gap),
            unit="time, in 20 s",
        ),
        Figure(
            name="plan_dense_count_gap",
            value=middle("dense", "count", lambda _, cover: cover.gap),
            unit="count, in 20 s",
        ),
        at_most("plan_dense_first_plan_s", _first_plan_s(), 5.0, "CPU s"),
    ]

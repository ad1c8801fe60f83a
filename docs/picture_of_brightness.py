"""p_norm over brightness in the simulated cell, bare and in primer, coloured by depth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D
from picture_style import ACCENT, ACCENT_2, ACCENT_3, INK, QUIET, save

from exposight.measuring import measure_observations
from exposight.plans import plan_preset
from exposight.twin import SimulatedCell

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from exposight.observing import ObservationTable
    from exposight.plans import MeasuringPlan
    from exposight.twin.part import Finish, Scene

_COLOURS = {"near": ACCENT, "middle": ACCENT_3, "far": ACCENT_2}
_BIN = 10.0  # grey levels
_FEWEST = 5  # observations that a median needs


def _share_of_the_paper_s_plan() -> MeasuringPlan:
    """Return every second row of positions of the paper's X plan, at all its exposures."""
    plan = plan_preset("x")
    return replace(plan, planes=tuple(replace(p, y_mm=p.y_mm[::2]) for p in plan.planes))


def _draw(axes: Axes, table: ObservationTable, kinematic: set[str]) -> None:
    seen = table.measured()
    i_avg, p_norm = seen.array(["i_avg", "p_norm"]).T
    view = np.array(seen.names("view"))
    by_robot = np.isin(view, list(kinematic))
    plane = np.array([name.split("-")[0] for name in view])
    for name, colour in _COLOURS.items():
        good, rough = (plane == name) & ~by_robot, (plane == name) & by_robot
        axes.scatter(i_avg[good], p_norm[good], s=7, color=colour, alpha=0.55, linewidths=0)
        axes.scatter(
            i_avg[rough], p_norm[rough], s=10, facecolors="none", edgecolors=colour, linewidths=0.7
        )
    middles, medians = _medians(i_avg, p_norm)
    axes.plot(middles, medians, color=INK, linewidth=1.6)
    axes.set(xlim=(0, 255), ylim=(-0.04, 1.08), xticks=range(0, 251, 50))
    axes.set_xlabel("brightness of the ring, $i_{avg}$ / grey level")


def _medians(i_avg: np.ndarray, p_norm: np.ndarray) -> tuple[list[float], list[float]]:
    """Return the median p_norm in every bin of brightness with enough observations."""
    number = (i_avg // _BIN).astype(int)
    full = [n for n in range(26) if (number == n).sum() >= _FEWEST]
    return [(n + 0.5) * _BIN for n in full], [float(np.median(p_norm[number == n])) for n in full]


def _observed(plan: MeasuringPlan, finish: Finish | None = None) -> ObservationTable:
    cell = SimulatedCell.for_plan(plan, rings_only=True, finish=finish)
    return measure_observations(plan, cell, workers=2)


def draw_brightness(scene: Scene) -> None:
    """Carry out a share of the paper's X plan on bare sheet and on primer, and draw p_norm."""
    plan = _share_of_the_paper_s_plan()
    cell = SimulatedCell.for_plan(plan)
    aligned = {view.name: cell.alignment(view.name).aligned_by for view in plan.views(scene.part)}
    kinematic = {name for name, method in aligned.items() if method == "kinematics"}
    tables = {
        "bare sheet metal": _observed(plan),
        "the same door in primer": _observed(plan, finish="primer"),
    }
    figure, panels = plt.subplots(1, 2, figsize=(10, 4.6), sharey=True, layout="constrained")
    for axes, (title, table) in zip(panels, tables.items(), strict=True):
        _draw(axes, table, kinematic)
        axes.set_title(f"{title}, {len(table.measured())} observations")
    panels[0].set_ylabel("share of points, $p_{norm}$")
    dots: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 4}
    heights = {plane.name: plane.z_tcp_mm for plane in plan.planes}
    keys = [
        Line2D(
            [],
            [],
            **dots,
            color=colour,
            label=f"{name} plane, z = {heights[name]:g} mm".replace("-", "−"),
        )
        for name, colour in _COLOURS.items()
    ]
    hollow = Line2D([], [], **dots, color=QUIET, fillstyle="none", label="aligned by robot alone")
    median = Line2D([], [], color=INK, label="median in 10 grey levels")
    figure.legend(
        handles=[*keys, hollow, median],
        loc="outside lower center",
        ncols=5,
        frameon=False,
        columnspacing=1.0,
        fontsize=8,
        handletextpad=0.3,
    )
    figure.suptitle("Numbers of the simulated cell, not of a real part", fontsize=9, color=QUIET)
    save(figure, "brightness")
    plt.close(figure)

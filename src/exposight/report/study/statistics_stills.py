"""Stills of dependence and learning: Figs. 20, 22 and 23."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.colors import LinearSegmentedColormap

from exposight.report.colours import ACCENT, INK
from exposight.report.quantities import column_math
from exposight.report.study.stills import draw_still, label_panel, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from exposight.paper import DependenceMatrix, LearningCurve
    from exposight.report.study.stills import Still


DEPENDENCE_SCALE = ("#ffffff", "#cfe3e7", "#7db4bf", "#2f8494", "#0b4957")
_DARK = 0.55


def dependence_still(data: DependenceMatrix) -> Still:
    """Draw the matrix of maximal information coefficients with their values (Fig. 20)."""
    names = [column_math(name) for name in data.columns]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        colours = LinearSegmentedColormap.from_list("own", DEPENDENCE_SCALE)
        image = axes.imshow(data.values, cmap=colours, vmin=0, vmax=1)
        places = range(len(names))
        axes.set_xticks(places, names)
        axes.set_yticks(places, names)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        for row in places:
            for column in places:
                value = float(data.values[row, column])
                axes.text(
                    column, row, f"{value:.2f}", ha="center", va="center", fontsize=7.5,
                    color="white" if value > _DARK else INK,
                )  # fmt: skip
        figure.colorbar(image, label="maximal information coefficient (1)", shrink=0.8)

    return draw_still(6.2, 5.2, draw)


def learning_still(data: LearningCurve, unit: str) -> Still:
    """Draw R² and RMSE over the number of training observations (Figs. 22 and 23).

    Parameters
    ----------
    data : LearningCurve
        The curve.
    unit : {'%', 'ms'}
        Of the RMSE; percent of full scale for p_norm.
    """
    numbers = [step.n_train for step in data.steps]
    factor = 100.0 if unit == "%" else 1.0

    def draw(figure: Figure) -> None:
        fit, error = figure.subplots(1, 2)
        fit.plot(numbers, [s.score.r2_percent for s in data.steps], "o-", color=ACCENT)
        plain_axes(fit, "training observations", "R² (%)")
        label_panel(fit, f"{data.variant}: R² on unseen features")
        error.plot(numbers, [factor * s.score.rmse for s in data.steps], "s-", color=INK)
        plain_axes(error, "training observations", f"RMSE ({unit})")
        label_panel(error, f"{data.variant}: RMSE on unseen features")
        fit.set_ylim(min(0.0, *(s.score.r2_percent for s in data.steps)), 102)
        error.set_ylim(0, 1.15 * factor * max(s.score.rmse for s in data.steps))
        for axes in (fit, error):
            axes.set_xlim(0, None)

    return draw_still(7.2, 2.9, draw)

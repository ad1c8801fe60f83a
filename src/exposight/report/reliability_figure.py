"""Whether chances and bands say what came true: the reliability picture."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr, ndtri

from exposight.models import P_NORM_MIN, Evaluation
from exposight.quantities import QUANTITIES
from exposight.report.figures import Still, draw_still, label_panel, plain_axes
from exposight.report.palette import ACCENT, INK, MUTED, OUTSIDE

_COLOURS = (ACCENT, OUTSIDE, "#7a4fa3", "#3f8f4f", INK, "#c2417c")
_SHARES = np.linspace(0.02, 0.98, 49)


def reliability_picture(evaluations: Sequence[Evaluation]) -> Still:
    """Draw chances said against the share that came true, and bands against what lies in them.

    Left, of quality models, the chance of `P_NORM_MIN`: a dot for each tenth, its size the number
    of rows. Right, of all models, the share of observations in the predicted band of each width.
    Calibrated predictions lie on the diagonal.
    """

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for axes in (left, right):
            axes.plot([0, 1], [0, 1], color=MUTED, linewidth=0.9, linestyle="--")
            axes.set_xlim(-0.04, 1.04)
            axes.set_ylim(-0.04, 1.04)
            axes.set_aspect("equal")
        for place, evaluation in enumerate(evaluations):
            colour = _COLOURS[place % len(_COLOURS)]
            if groups := evaluation.reliability:
                total = sum(group.n for group in groups)
                left.scatter(
                    [group.said for group in groups], [group.came_true for group in groups],
                    s=[12 + 220 * group.n / total for group in groups], color=colour, alpha=0.75,
                    linewidth=0,
                )  # fmt: skip
            right.plot(_SHARES, _band_shares(evaluation), color=colour, label=evaluation.model.name)
        plain_axes(left, "chance said", "share that came true")
        label_panel(left, f"{QUANTITIES['p_norm'].math} ≥ {P_NORM_MIN:g}")
        plain_axes(right, "share that the band is to hold", "share in the band")
        label_panel(right, "bands")
        figure.legend(loc="outside lower center", ncols=4)

    return draw_still("reliability", "Chances and bands, and what came of them", (7.4, 3.9), draw)


def _band_shares(evaluation: Evaluation) -> list[float]:
    """Return the share of observations in the central band of each of `_SHARES`.

    Bands with equal tails, and both ends included: where a distribution ends at a point, as p_norm
    does at 0, an observation there is in every band that reaches it.
    """
    ends = ndtr(np.outer([-1.0, 1.0], ndtri(0.5 + 0.5 * _SHARES)))
    low, high = (evaluation.prediction.quantiles(levels.tolist()) for levels in ends)
    slack = 1e-9
    inside = (low - slack <= evaluation.observed) & (evaluation.observed <= high + slack)
    return [float(share) for share in inside.mean(axis=1)]

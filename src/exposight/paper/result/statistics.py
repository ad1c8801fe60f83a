"""What the appendix looks at: learning curves, and the dependence of variables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from exposight.paper.result.rungs import EvaluationRole
    from exposight.statistics import RegressionScore


@dataclass(frozen=True, kw_only=True)
class LearningStep:
    """A rung trained on fewer rows.

    Parameters
    ----------
    n_train : int
        Rows it learnt from, drawn at random from the rung's training rows.
    score : RegressionScore
        On unseen features, in the target's own unit (p_norm 0–1, or ms).
    """

    n_train: int
    score: RegressionScore


@dataclass(frozen=True, kw_only=True)
class LearningCurve:
    """Figs. 22 and 23: how scores on unseen features depend on the number of observations.

    Parameters
    ----------
    rung : str
        Name of the rung.
    dataset : str
        What it is judged by.
    role : {'test', 'test_inside'}
        All unseen rows, or those inside the box of all the rung's training rows.
    steps : tuple of LearningStep
        By growing number; the last has all rows.
    """

    rung: str
    dataset: str
    role: EvaluationRole
    steps: tuple[LearningStep, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class DependenceMatrix:
    """Fig. 20: maximal information coefficients of every two variables.

    Parameters
    ----------
    dataset : str
        Whose training rows.
    columns : tuple of str
        Columns of the observation table.
    values : (d, d) ndarray
        0–1, symmetric.
    """

    dataset: str
    columns: tuple[str, ...]
    values: NDArray[np.float64]

    def between(self, first: str, second: str) -> float:
        """Return the coefficient of two columns."""
        return float(self.values[self.columns.index(first), self.columns.index(second)])

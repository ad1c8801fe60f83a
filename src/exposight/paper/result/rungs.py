"""The ladder's rungs: what each learns from, what judges it, and how it did."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from exposight.errors import InputError

if TYPE_CHECKING:
    from exposight.models import Evaluation, ModelSpecification, TrainedModel
    from exposight.paper.result.settings import SensorKind
    from exposight.statistics import RegressionScore


EvaluationRole = Literal["validation", "validation_by_view", "test", "test_inside", "extended"]
"""How evaluation rows relate to those trained on.

``validation``: the rest of the random split, as in the paper. ``validation_by_view``: the rest of a
split by whole views. ``test``: unseen features. ``test_inside``: of these, the rows inside the
training rows' box in x, y, z, w, p (the paper's "test,i"). ``extended``: Sects. 4.1 and 4.3.
"""


@dataclass(frozen=True, kw_only=True)
class RungEvaluation:
    """One line under a rung in Tables 2 to 6.

    Parameters
    ----------
    table : int
        The paper's table, 2 to 6.
    dataset : str
        Of `Dataset`: the rung's own for validation, else where the rows come from.
    role : str
        See `EvaluationRole`.
    paper_dataset : str
        As in the paper's table, for instance ``eX6_val_plusplus``.
    features : tuple of str
        Only these; empty for all of the dataset's.
    paper_features : str
        As in the paper's table, for instance ``f1-4_test``.
    inside : tuple of str
        Only rows inside the training rows' range in these columns, at the resolution of Table 9,
        whole mm and degrees; empty for all rows.
    """

    table: int
    dataset: str
    role: EvaluationRole
    paper_dataset: str
    paper_features: str
    features: tuple[str, ...] = ()
    inside: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One step of the ladder: a model, what it learns from, and what it is judged by.

    Parameters
    ----------
    name : str
        As the paper names the kernel: ``q_k4``, ``e_k4_plus``, ``e_k6_plusplus``, ``q_k4_s2``, …
    title : str
        For people.
    sensor : {'structured-light', 'stereo'}
        Which sensor's.
    specification : ModelSpecification
        Target, inputs and kernel.
    dataset : str
        Name of the dataset whose training side it learns from.
    evaluations : tuple of RungEvaluation
        In the order of the paper's tables.
    """

    name: str
    title: str
    sensor: SensorKind
    specification: ModelSpecification
    dataset: str
    evaluations: tuple[RungEvaluation, ...]

    @property
    def unit(self) -> Literal["%", "ms"]:
        """Unit of RMSE and MAE in tables: percent of full scale for p_norm, ms for exposures."""
        return "%" if self.specification.target == "p_norm" else "ms"


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """A trained rung held against one set of rows.

    Parameters
    ----------
    rung : str
        Name of the rung.
    evaluation : RungEvaluation
        Which rows.
    result : Evaluation or None
        Rows, observed targets, predictions with their standard deviation; None where there are no
        such rows.
    score : RegressionScore or None
        R² in percent; MSE, RMSE, MAE in the target's own unit (p_norm 0–1, or ms); coverage.
    relative_error_percent : float or None
        Mean of |predicted − true| / true in percent; None but for exposure times.
    """

    rung: str
    evaluation: RungEvaluation
    result: Evaluation | None
    score: RegressionScore | None
    relative_error_percent: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedRung:
    """A rung, its model, and its scores.

    Parameters
    ----------
    rung : Rung
        What it is.
    model : TrainedModel
        Trained on the random split's training side.
    path : Path
        The model's file, below the study's folder.
    scores : tuple of Score
        In the order of ``rung.evaluations``.
    """

    rung: Rung
    model: TrainedModel
    path: Path
    scores: tuple[Score, ...]

    def score(
        self, role: EvaluationRole, *, dataset: str | None = None, features: tuple[str, ...] = ()
    ) -> Score:
        """Return the score with this role, of this dataset, for these features (none: all).

        Raises
        ------
        InputError
            If there is none.
        """
        for score in self.scores:
            line = score.evaluation
            if line.role == role and dataset in (None, line.dataset) and features == line.features:
                return score
        msg = (
            f"rung {self.rung.name!r} has no score {role!r} on {dataset or 'any dataset'}; it has "
            + ", ".join(f"{s.evaluation.role} on {s.evaluation.dataset}" for s in self.scores)
        )
        raise InputError(msg)

"""A trained model: predictions with their uncertainty, and whether to believe them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from exposight import __version__
from exposight.errors import ObservationError
from exposight.statistics import RegressionScore, inside_box, score

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from exposight.cell import ActiveSensor
    from exposight.gp import GaussianProcess
    from exposight.models.specification import ModelSpecification
    from exposight.observing import ObservationTable


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelPrediction:
    """What a model predicts for n inputs.

    Parameters
    ----------
    mean : (n,) ndarray
        In the target's unit.
    std : (n,) ndarray
        Standard deviation of a new observation, measurement noise included.
    inside : (n,) ndarray of bool
        Whether the input lies in the box that the training inputs span. Outside, the model
        extrapolates, and the paper's test features show how far off it then may be (Table 3).
    """

    mean: NDArray[np.float64]
    std: NDArray[np.float64]
    inside: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a trained model comes from.

    Parameters
    ----------
    observations : str
        What it was trained on, for instance the table's file name.
    observations_sha256 : str or None
        Checksum of that file, where it was one.
    emulated : bool
        True where any training observation was emulated rather than recorded.
    seed : int
        Seed of the restarts.
    exposight_version : str
        The program that trained it.
    """

    observations: str
    observations_sha256: str | None
    emulated: bool
    seed: int
    exposight_version: str


@dataclass(frozen=True, kw_only=True)
class FitSummary:
    """How the hyperparameters were found.

    Parameters
    ----------
    log_marginal_likelihood : float
        Of the training data.
    converged : bool
        Whether the best start converged.
    evaluations : int
        Of likelihood and gradient, over all starts.
    starts : int
        How many starts there were.
    parameters_at_bound : tuple of str
        Hyperparameters that ended at a limit.
    seconds : float or None
        Wall time; None where the model was read from a file, which does not hold it.
    """

    log_marginal_likelihood: float
    converged: bool
    evaluations: int
    starts: int
    parameters_at_bound: tuple[str, ...]
    seconds: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """A model and everything needed to use, check and repeat it.

    Parameters
    ----------
    specification : ModelSpecification
        Name, target, inputs and the form of the kernel.
    process : GaussianProcess
        Kernel with its hyperparameters, noise variance and training data.
    summary : FitSummary
        How it was fitted.
    provenance : Provenance
        From what.
    sensor : ActiveSensor or None
        The sensor that the observations are of; a model holds for this one alone.
    """

    specification: ModelSpecification
    process: GaussianProcess
    summary: FitSummary
    provenance: Provenance
    sensor: ActiveSensor | None

    def predict(self, inputs: ArrayLike) -> ModelPrediction:
        """Predict for (n, d) inputs in the specification's order and units.

        Raises
        ------
        ObservationError
            If the shape is wrong or a value is not finite.
        """
        x = np.asarray(inputs, dtype=np.float64)
        prediction = self.process.predict(x, include_noise=True)
        return ModelPrediction(
            mean=prediction.mean, std=prediction.std, inside=inside_box(self.process.x, x)
        )

    def predict_table(self, table: ObservationTable) -> ModelPrediction:
        """Predict for every row of an observation table, which must have all inputs."""
        return self.predict(table.array(self.specification.inputs))

    def with_observations(
        self, table: ObservationTable, *, source: str = "a table in memory"
    ) -> TrainedModel:
        """Learn from more observations, as a cell does after each capture.

        The hyperparameters stay; where the new observations lie far from the old ones, `train`
        on all of them. With two thousand observations it takes some ten milliseconds.

        Parameters
        ----------
        table : ObservationTable
            Observations; those that this model does not learn from are left out
            (`ModelSpecification.rows`), be it all of them.
        source : str
            What the table is; added to the model's provenance.

        Returns
        -------
        TrainedModel

        Raises
        ------
        NotPositiveDefiniteError
            If the observations leave the covariance matrix without a Cholesky factor.
        """
        rows = self.specification.rows(table)
        if len(rows) == 0:
            return self
        process = self.process.with_observations(*self.specification.data(rows))
        return replace(
            self,
            process=process,
            summary=replace(self.summary, log_marginal_likelihood=process.log_marginal_likelihood),
            provenance=replace(
                self.provenance,
                observations=f"{self.provenance.observations}; {source}",
                observations_sha256=None,
                emulated=self.provenance.emulated or bool(rows.frame["emulated"].any()),
                exposight_version=__version__,
            ),
        )

    def training_range(self) -> dict[str, tuple[float, float]]:
        """Return the smallest and largest training value of each input, in its unit."""
        low, high = self.process.x.min(axis=0).tolist(), self.process.x.max(axis=0).tolist()
        return dict(zip(self.specification.inputs, zip(low, high, strict=True), strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """A model held against observations.

    Parameters
    ----------
    specification : ModelSpecification
        Which model.
    table : ObservationTable
        The rows it was judged by.
    observed : (n,) ndarray
        Targets, in their unit.
    prediction : ModelPrediction
        What was predicted for them.
    score : RegressionScore
        R², MSE, RMSE, MAE and the bands' coverage.
    score_inside : RegressionScore or None
        The same for the rows inside the training data's range (the paper's X_test,i); None where
        there are none.
    """

    specification: ModelSpecification
    table: ObservationTable
    observed: NDArray[np.float64]
    prediction: ModelPrediction
    score: RegressionScore
    score_inside: RegressionScore | None


def evaluate(model: TrainedModel, table: ObservationTable) -> Evaluation:
    """Hold a model against observations, those of its own kind of rows.

    Raises
    ------
    ObservationError
        If no row is left.
    """
    rows = usable_rows(model.specification, table, "evaluate")
    x, observed = model.specification.data(rows)
    prediction = model.predict(x)
    inside = prediction.inside
    return Evaluation(
        specification=model.specification,
        table=rows,
        observed=observed,
        prediction=prediction,
        score=score(observed, prediction.mean, prediction.std),
        score_inside=score(observed[inside], prediction.mean[inside], prediction.std[inside])
        if inside.any()
        else None,
    )


def usable_rows(
    specification: ModelSpecification, table: ObservationTable, purpose: str
) -> ObservationTable:
    """Return the rows that a model learns from and is judged by.

    Raises
    ------
    ObservationError
        If there is none.
    """
    rows = specification.rows(table)
    if len(rows) == 0:
        wanted = (
            "measured observations"
            if specification.p_norm_min is None
            else f"measured observations with p_norm ≥ {specification.p_norm_min:g}"
        )
        counts = ", ".join(f"{count} {reason}" for reason, count in table.counts().items())
        msg = f"cannot {purpose} {specification.name}: it needs {wanted}, and " + (
            f"none of the table's {len(table)} rows is one ({counts or 'no rows'})"
            if len(table) != 1
            else f"the table's only row is none ({counts})"
        )
        raise ObservationError(msg)
    return rows

"""The paper's kind of predictor: a Gaussian process, exact or as a committee of exact experts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any, ClassVar

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import Field

from exposight import __version__
from exposight.errors import InputError
from exposight.files import validate
from exposight.gp import Committee, GaussianProcess, Parameter, kernel_from_dict
from exposight.gp.observations import read_only
from exposight.models import predictor
from exposight.models.prediction import Prediction
from exposight.models.specification import ModelSpecification, TargetScale
from exposight.observing import ObservationTable
from exposight.quantities import quantity
from exposight.statistics import inside_box
from exposight.tables import counted
from exposight.workers import Progress, ignore_progress

_NOISE = "noise_variance"


@dataclass(frozen=True, kw_only=True)
class FitSummary:
    """How the hyperparameters were found.

    Parameters
    ----------
    log_marginal_likelihood : float
        Of the training data; of a committee's, the sum over its shards.
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


@predictor.register_predictor
@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianProcessModel(predictor.Predictor):
    """A trained Gaussian process and everything needed to use, check and repeat it.

    Parameters
    ----------
    name, title, target, inputs, provenance, sensor
        As in `Predictor`.
    p_norm_min : float or None
        It learns only from observations of at least this quality (Sect. 3.4.1); None for all.
    source : str
        Where in the paper it is defined.
    target_scale : {"linear", "log"}
        Scale of the target on which `process` works (`ModelSpecification`).
    process : GaussianProcess or Committee
        Kernel with its hyperparameters, noise variance and training data, targets on that scale.
    summary : FitSummary
        How it was fitted.
    """

    kind: ClassVar[str] = "gaussian-process"

    p_norm_min: float | None = None
    source: str = ""
    target_scale: TargetScale = "linear"
    process: GaussianProcess | Committee
    summary: FitSummary

    @property
    def specification(self) -> ModelSpecification:
        """What the model is, untrained; its kernel has the hyperparameters that were found."""
        return ModelSpecification(
            name=self.name,
            title=self.title,
            target=self.target,
            inputs=self.inputs,
            kernel=self.process.kernel,
            p_norm_min=self.p_norm_min,
            source=self.source,
            target_scale=self.target_scale,
        )

    def predict_frame(self, frame: pl.DataFrame) -> Prediction:
        """Predict for a frame whose columns are `inputs`, in their order."""
        return self.predict_in_steps(frame, ignore_progress)

    def predict_in_steps(self, frame: pl.DataFrame, progress: Progress) -> Prediction:
        """As `predict_frame`; tells the rows that are done."""
        x = predictor.input_array(self.name, frame)
        inside = inside_box(self.process.x, x)
        of_process = self.process.predict(x, include_noise=True, progress=progress)
        mean, std = of_process.mean, of_process.std
        if self.target_scale == "linear":
            return Prediction(mean=mean, std=std, inside=inside)
        # the log-normal distribution's moments, endless where the process knows next to nothing
        with np.errstate(over="ignore"):
            median, spread = np.exp(mean), np.expm1(std**2)
            mean_of_target = median * np.sqrt(1.0 + spread)
            return Prediction(
                mean=mean_of_target,
                std=mean_of_target * np.sqrt(spread),
                inside=inside,
                low=np.exp(mean - 2.0 * std),
                high=np.exp(mean + 2.0 * std),
            )

    def unknown(self, data: ObservationTable | pl.DataFrame) -> tuple[str, ...]:
        """Say for each row why its prediction should not be relied on; empty where it may be."""
        frame = self._inputs(data, {})
        return self._beyond(
            frame, inside_box(self.process.x, predictor.input_array(self.name, frame))
        )

    @property
    def _targets(self) -> NDArray[np.float64]:
        """Training targets in their unit, (n,), read-only."""
        y = self.process.y
        return y if self.target_scale == "linear" else read_only(np.exp(y))

    def rows(self, table: ObservationTable) -> ObservationTable:
        """Return the rows that the model learns from and is evaluated on."""
        return self.specification.rows(table)

    @property
    def n_observations(self) -> int:
        """Number of training observations."""
        return len(self.process.y)

    @property
    def experts(self) -> int:
        """Number of a committee's experts; 1 for an exact Gaussian process."""
        return self.process.experts if isinstance(self.process, Committee) else 1

    @property
    def training_data(self) -> dict[str, NDArray[np.float64]]:
        """Training values by column, inputs and then target, each (n,), read-only."""
        columns = dict(zip(self.inputs, self.process.x.T, strict=True))
        return {**columns, self.target: self._targets}

    @property
    def training_range(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest training value of each input."""
        low, high = self.process.x.min(axis=0).tolist(), self.process.x.max(axis=0).tolist()
        return dict(zip(self.inputs, zip(low, high, strict=True), strict=True))

    @property
    def target_range(self) -> tuple[float, float]:
        """Smallest and largest training value of the target."""
        return float(self._targets.min()), float(self._targets.max())

    def with_observations(self, table: ObservationTable) -> GaussianProcessModel:
        """Learn from more observations, as a cell does after each capture.

        The hyperparameters stay; where the new observations lie far from the old ones, train on
        all of them. With two thousand observations it takes some ten milliseconds. Observations
        that this model does not learn from are left out (`rows`), be it all of them.

        Raises
        ------
        InputError
            If the model is a committee, which has to be trained again.
        NotPositiveDefiniteError
            If the observations leave the covariance matrix without a Cholesky factor.
        """
        rows = self.rows(table)
        if len(rows) == 0:
            return self
        if isinstance(self.process, Committee):
            msg = (
                f"{self.name} is a committee of {self.experts} experts: train it again on all rows"
            )
            raise InputError(msg)
        process = self.process.with_observations(*self.specification.data(rows))
        return replace(
            self,
            process=process,
            summary=replace(self.summary, log_marginal_likelihood=process.log_marginal_likelihood),
            provenance=replace(
                self.provenance,
                observations=f"{self.provenance.observations}; {counted(len(rows), 'more row')}",
                observations_sha256=None,
                emulated=self.provenance.emulated or bool(rows.frame["emulated"].any()),
                exposight_version=__version__,
            ),
        )

    def with_training_rows(self, table: ObservationTable) -> GaussianProcessModel:
        """Return a model with the same hyperparameters that has learnt from other rows instead.

        Raises
        ------
        NotPositiveDefiniteError
            If the observations leave the covariance matrix without a Cholesky factor.
        """
        x, y = self.specification.data(self.rows(table))
        kernel, noise_variance = self.process.kernel, self.process.noise_variance
        return replace(self, process=GaussianProcess.condition(kernel, noise_variance, x, y))

    def hyperparameters(self) -> tuple[predictor.Hyperparameter, ...]:
        """Return the hyperparameters with their units, the noise variance last."""
        at_limit = self.summary.parameters_at_bound
        noise = predictor.Hyperparameter(
            name=_NOISE,
            quantity="variance",
            inputs=(),
            value=self.process.noise_variance,
            unit=self._squared_unit,
            remark="at limit" if _NOISE in at_limit else "",
        )
        parameters = (
            predictor.Hyperparameter(
                name=parameter.name,
                quantity=parameter.quantity.value,
                inputs=tuple(self.inputs[dim] for dim in parameter.dims),
                value=parameter.value,
                # A fixed variance is 1 so that another factor's alone carries the unit.
                unit=self._unit_of(parameter) if parameter.free else "",
                remark=_remark(parameter, at_limit),
            )
            for parameter in self.process.kernel.parameters
        )
        return (*parameters, noise)

    @property
    def _squared_unit(self) -> str:
        return quantity(self.target).squared_unit if self.target_scale == "linear" else ""

    def _unit_of(self, parameter: Parameter) -> str:
        suffix = quantity(self.target).suffix if self.target_scale == "linear" else ""
        units = {quantity(self.inputs[dim]).suffix for dim in parameter.dims}
        unit = units.pop() if len(units) == 1 else "mixed"
        match parameter.quantity.value:
            case "variance":
                return self._squared_unit
            case "length_scale":
                return unit
            case "slope_variance":
                return f"({suffix or '1'}/{unit})²"
        return ""

    def to_document(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return kernel, noise and fit, and the arrays that were trained on."""
        fit = asdict(self.summary)
        del fit["seconds"]
        content = {
            "source": self.source,
            "p_norm_min": self.p_norm_min,
            "target_scale": self.target_scale,
            "kernel": self.process.kernel.to_dict(),
            "noise_variance": self.process.noise_variance,
            "fit": fit,
        }
        arrays: dict[str, NDArray[Any]] = {"inputs": self.process.x, "targets": self.process.y}
        if isinstance(self.process, Committee):
            arrays["shard"] = self.process.shard
        elif self.process.row_noise is not None:
            arrays["row_noise"] = self.process.row_noise
        return content, arrays

    @classmethod
    def from_document(
        cls, common: Mapping[str, Any], content: dict[str, Any], arrays: Mapping[str, NDArray[Any]]
    ) -> GaussianProcessModel:
        """Rebuild a model; factors follow from the data and are computed again."""
        kept = validate(_Content, content, "model.json")
        kernel = kernel_from_dict(kept.kernel)
        x, y = np.asarray(arrays["inputs"], dtype=np.float64), arrays["targets"]
        if x.ndim != 2 or x.shape[1] != len(common["inputs"]):
            msg = (
                f"inputs.npy must have a column for each of {len(common['inputs'])} inputs, got "
                f"shape {x.shape}"
            )
            raise InputError(msg)
        process: GaussianProcess | Committee
        if "shard" in arrays:
            process = Committee.from_shards(kernel, kept.noise_variance, x, y, arrays["shard"])
        else:
            process = GaussianProcess.condition(
                kernel, kept.noise_variance, x, y, row_noise=arrays.get("row_noise")
            )
        return cls(
            **common,
            p_norm_min=kept.p_norm_min,
            source=kept.source,
            target_scale=kept.target_scale,
            process=process,
            summary=kept.fit,
        )


@dataclass(frozen=True, kw_only=True)
class _Content:
    source: str
    p_norm_min: float | None
    target_scale: TargetScale = "linear"
    kernel: dict[str, Any]
    noise_variance: Annotated[float, Field(gt=0)]
    fit: FitSummary


def _remark(parameter: Parameter, at_limit: tuple[str, ...]) -> str:
    if not parameter.free:
        return "fixed"
    return "at limit" if parameter.name in at_limit else ""

"""A trained model's hyperparameters with what they act on and their units, for printing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from exposight.cli.facts import short_unit
from exposight.cli.output import number, print_table

if TYPE_CHECKING:
    from exposight.gp import Parameter
    from exposight.models import ModelSpecification, TrainedModel


_NOISE = "noise_variance"


@dataclass(frozen=True, kw_only=True)
class Hyperparameter:
    """One hyperparameter, as people read it.

    Parameters
    ----------
    name : str
        As in the kernel's tree.
    inputs : tuple of str
        The model's inputs that it acts on; empty for the noise.
    value : float
        In `unit`.
    unit : str
        Empty for plain numbers; "mixed" where one length scale serves several units, as in the
        paper's kernels without ARD.
    remark : str
        "fixed", "at limit", or nothing.
    """

    name: str
    inputs: tuple[str, ...]
    value: float
    unit: str
    remark: str


def describe_hyperparameters(model: TrainedModel) -> tuple[Hyperparameter, ...]:
    """Return a model's hyperparameters, the noise variance last."""
    specification, at_limit = model.specification, model.summary.parameters_at_bound
    noise = Hyperparameter(
        name=_NOISE,
        inputs=(),
        value=model.process.noise_variance,
        unit=_square(short_unit(specification.target)),
        remark="at limit" if _NOISE in at_limit else "",
    )
    return (
        *(
            Hyperparameter(
                name=parameter.name,
                inputs=tuple(specification.inputs[dim] for dim in parameter.dims),
                value=parameter.value,
                # A fixed variance is 1 so that another factor's alone carries the unit.
                unit=_unit(parameter, specification) if parameter.free else "",
                remark=_remark(parameter, at_limit),
            )
            for parameter in model.process.kernel.parameters
        ),
        noise,
    )


def print_hyperparameters(model: TrainedModel) -> None:
    """Print a model's hyperparameters as a table."""
    print_table(
        ("kernel", "parameter", "acts on", "value", "unit", "remark"),
        (
            (
                *_spelled_name(own),
                _spelled_inputs(own.inputs, model.specification.inputs),
                number(own.value),
                own.unit,
                own.remark,
            )
            for own in describe_hyperparameters(model)
        ),
        words=("parameter", "acts on", "unit", "remark"),
    )


def _spelled_name(own: Hyperparameter) -> tuple[str, str]:
    """Return kernel and quantity; which input a bracketed number means stands beside them."""
    kernel, _, quantity = own.name.rpartition(".")
    return kernel.replace("_", " "), quantity.split("[")[0].replace("_", " ")


def _spelled_inputs(inputs: tuple[str, ...], every: tuple[str, ...]) -> str:
    others = [name for name in every if name not in inputs]
    if not others and len(every) > 1:
        return "all inputs"
    if len(others) == 1 and len(inputs) > 1:
        return f"all but {others[0]}"
    return ", ".join(inputs)


def hyperparameter_documents(model: TrainedModel) -> list[dict[str, object]]:
    """Return a model's hyperparameters for a JSON document."""
    return [asdict(own) for own in describe_hyperparameters(model)]


def _remark(parameter: Parameter, at_limit: tuple[str, ...]) -> str:
    if not parameter.free:
        return "fixed"
    return "at limit" if parameter.name in at_limit else ""


def _unit(parameter: Parameter, specification: ModelSpecification) -> str:
    target = short_unit(specification.target)
    units = {short_unit(specification.inputs[dim]) for dim in parameter.dims}
    unit = units.pop() if len(units) == 1 else "mixed"
    match parameter.quantity.value:
        case "variance":
            return _square(target)
        case "length_scale":
            return unit
        case "slope_variance":
            return _square(f"({target or '1'}/{unit})")
    return ""


def _square(unit: str) -> str:
    return f"{unit}²" if unit else ""

"""A trained model's hyperparameters with what they act on and their units, for printing."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from exposight.cli.output import number, print_table

if TYPE_CHECKING:
    from exposight.models import GaussianProcessModel, Hyperparameter


def print_hyperparameters(model: GaussianProcessModel) -> None:
    """Print a model's hyperparameters as a table."""
    print_table(
        ("kernel", "parameter", "acts on", "value", "unit", "remark"),
        (
            (
                *_spelled_name(own),
                _spelled_inputs(own.inputs, model.inputs),
                number(own.value),
                own.unit,
                own.remark,
            )
            for own in model.hyperparameters()
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


def hyperparameter_documents(model: GaussianProcessModel) -> list[dict[str, object]]:
    """Return a model's hyperparameters for a JSON document."""
    return [asdict(own) for own in model.hyperparameters()]

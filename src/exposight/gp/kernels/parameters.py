"""Hyperparameters of a kernel, as records."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum


class Quantity(StrEnum):
    """What a hyperparameter measures; decides its default bounds and starting value."""

    VARIANCE = "variance"
    LENGTH_SCALE = "length_scale"
    ALPHA = "alpha"
    SLOPE_VARIANCE = "slope_variance"


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One hyperparameter of a kernel.

    Attributes
    ----------
    name : str
        Unique within its tree: ``rational_quadratic.alpha``, ``exponential_2.length_scale[4]``
        (the number in brackets is the column of the inputs).
    value : float
        Positive; a variance in squared units of the target, a length scale in the unit of its
        column.
    quantity : Quantity
        What it measures.
    dims : tuple of int
        Columns of the inputs that it acts on.
    free : bool
        Whether fitting may change it.
    """

    name: str
    value: float
    quantity: Quantity
    dims: tuple[int, ...]
    free: bool


def name_parameters(
    leaves: Iterable[tuple[str, tuple[Parameter, ...]]],
) -> tuple[Parameter, ...]:
    """Put the names of their kernels before the names of hyperparameters.

    Parameters
    ----------
    leaves : iterable of (str, tuple of Parameter)
        Type name and hyperparameters of each leaf of a tree, from left to right.

    Returns
    -------
    tuple of Parameter
        Kernels of one type are numbered from 1 where a tree holds several.
    """
    with_parameters = [(name, own) for name, own in leaves if own]
    occurrences = Counter(name for name, _ in with_parameters)
    seen: Counter[str] = Counter()
    named: list[Parameter] = []
    for name, own in with_parameters:
        seen[name] += 1
        prefix = f"{name}_{seen[name]}" if occurrences[name] > 1 else name
        named += [replace(parameter, name=f"{prefix}.{parameter.name}") for parameter in own]
    return tuple(named)

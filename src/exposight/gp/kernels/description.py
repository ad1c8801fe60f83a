"""Kernels out of their descriptions, as a model file holds them."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from exposight.errors import InputError
from exposight.gp.kernels.base import Kernel, Product, Sum
from exposight.gp.kernels.change_point import ChangePoint
from exposight.gp.kernels.leaf import Leaf
from exposight.gp.kernels.linear import Linear
from exposight.gp.kernels.rational_quadratic import RationalQuadratic
from exposight.gp.kernels.stationary import (
    Exponential,
    Matern32,
    Matern52,
    SquaredExponential,
)

_LEAVES: dict[str, type[Leaf]] = {
    leaf.type_name: leaf
    for leaf in (
        ChangePoint,
        Exponential,
        Linear,
        Matern32,
        Matern52,
        RationalQuadratic,
        SquaredExponential,
    )
}


def kernel_from_dict(description: Mapping[str, Any]) -> Kernel:
    """Build the kernel that `Kernel.to_dict` described.

    Parameters
    ----------
    description : mapping
        ``type`` and the fields of the kernel; ``factors`` or ``terms`` hold descriptions.

    Returns
    -------
    Kernel

    Raises
    ------
    InputError
        If the type is unknown, a key is missing or unexpected, or a value cannot be right.
    """
    if not isinstance(description, Mapping):
        msg = f"a kernel is described by a mapping, got {type(description).__name__}"
        raise InputError(msg)
    if "type" not in description:
        msg = f"a kernel's description needs the key 'type', got {sorted(description)}"
        raise InputError(msg)
    values = {key: value for key, value in description.items() if key != "type"}
    match description["type"]:
        case Product.type_name:
            return Product(factors=_children(values, "factors", Product.type_name))
        case Sum.type_name:
            return Sum(terms=_children(values, "terms", Sum.type_name))
        case str(name) if name in _LEAVES:
            return _leaf(_LEAVES[name], values)
        case name:
            known = ", ".join(sorted([*_LEAVES, Product.type_name, Sum.type_name]))
            msg = (
                f"unknown kernel type {name!r}; this version of exposight knows {known}. "
                "A newer version may have written it"
            )
            raise InputError(msg)


def _children(values: dict[str, Any], key: str, type_name: str) -> tuple[Kernel, ...]:
    _check_keys(values, required={key}, allowed={key}, type_name=type_name)
    if not isinstance(values[key], list | tuple):
        msg = f"{key} of a {type_name} must be a list of kernels, got {values[key]!r}"
        raise InputError(msg)
    return tuple(kernel_from_dict(child) for child in values[key])


def _leaf(leaf: type[Leaf], values: dict[str, Any]) -> Kernel:
    own = fields(leaf)  # type: ignore[arg-type]  # every leaf is a dataclass
    _check_keys(
        values,
        required={field.name for field in own if field.default is MISSING},
        allowed={field.name for field in own},
        type_name=leaf.type_name,
    )
    return leaf(**values)


def _check_keys(
    values: dict[str, Any], *, required: set[str], allowed: set[str], type_name: str
) -> None:
    missing, unexpected = required - set(values), set(values) - allowed
    if missing or unexpected:
        msg = (
            f"the description of a kernel of type {type_name!r} "
            f"lacks {sorted(missing)} and has the unexpected {sorted(unexpected)}; "
            f"it holds {sorted(allowed)}"
        )
        raise InputError(msg)

"""What kernels are in files: the registry of their types, descriptions that JSON can hold."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from exposight.errors import InputError

_Kind = TypeVar("_Kind", bound=type[Any])

_KINDS: dict[str, type[Any]] = {}


def register_kernel(kind: _Kind) -> _Kind:
    """Make a type of kernel known, so that files with it can be read; a class decorator.

    It goes above ``@dataclass``. Descriptions hold the dataclass's fields: numbers, text, kernels,
    and tuples of them.

    Raises
    ------
    InputError
        If the class is no dataclass, or has no `type_name` of its own.
    """
    name = getattr(kind, "type_name", "")
    if not is_dataclass(kind) or not name or not _same(_KINDS.get(name, kind), kind):
        msg = (
            f"{kind.__name__} must be a frozen dataclass with a type_name of its own, got "
            f"{name!r}, taken: {', '.join(_KINDS)}"
        )
        raise InputError(msg)
    _KINDS[name] = kind
    return kind


def _same(known: type[Any], kind: type[Any]) -> bool:
    """Whether a class is the registered one, perhaps defined again by a notebook's cell."""
    return (known.__module__, known.__qualname__) == (kind.__module__, kind.__qualname__)


def describe(kernel: Any) -> dict[str, Any]:
    """Describe a kernel with what JSON can hold (`Kernel.to_dict`).

    Raises
    ------
    InputError
        If its type is not registered, or a field holds something else than numbers, text, kernels
        and tuples of them.
    """
    kind = type(kernel)
    known = _KINDS.get(kind.type_name)
    if known is None or not _same(known, kind):
        msg = (
            f"{kind.__name__} cannot be described, since nothing could read it: decorate the class "
            "with exposight.gp.register_kernel, and give it a type_name of its own"
        )
        raise InputError(msg)
    module = {} if kind.__module__.startswith("exposight.") else {"module": kind.__module__}
    values = {
        field.name: _plain(getattr(kernel, field.name), f"{kind.__name__}.{field.name}")
        for field in fields(kernel)
    }
    return {"type": kind.type_name, **module, **values}


def _plain(value: object, name: str) -> object:
    if hasattr(type(value), "type_name"):
        return describe(value)
    if isinstance(value, tuple | list):
        return [_plain(item, name) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    msg = (
        f"{name} must hold a number, text, a kernel, or a tuple of them to be kept in a file, got "
        f"{type(value).__name__}"
    )
    raise InputError(msg)


def build(description: object) -> Any:
    """Build the kernel that a description holds; errors as for `kernel_from_dict`."""
    if not isinstance(description, Mapping):
        msg = f"a kernel is described by a mapping, got {type(description).__name__}"
        raise InputError(msg)
    if "type" not in description:
        msg = f"a kernel's description needs the key 'type', got {sorted(description)}"
        raise InputError(msg)
    name, module = description["type"], description.get("module")
    kind = _KINDS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise InputError(_unknown(name, module))
    values = {
        key: _built(value) for key, value in description.items() if key not in ("type", "module")
    }
    _check_keys(values, kind)
    try:
        return kind(**values)
    except (AttributeError, TypeError, ValueError) as error:
        msg = f"the description of a kernel of type {name!r} makes no sense: {error}"
        raise InputError(msg) from error


def _built(value: object) -> object:
    if isinstance(value, Mapping):
        return build(value)
    return tuple(map(_built, value)) if isinstance(value, list | tuple) else value


def _unknown(name: object, module: object) -> str:
    remedy = "a newer version of exposight may have written it"
    if module is not None:
        script = module in ("__main__", "__mp_main__")
        where = "the script" if script else f"the module {module}"
        remedy = f"first import {where} that defines it and registers it by register_kernel"
    return f"unknown kernel type {name!r}; known are {', '.join(sorted(_KINDS))}; {remedy}"


def _check_keys(values: Mapping[str, object], kind: type[Any]) -> None:
    known = [field for field in fields(kind) if field.init]
    required = {
        field.name
        for field in known
        if field.default is MISSING and field.default_factory is MISSING
    }
    missing, unexpected = required - set(values), set(values) - {field.name for field in known}
    if missing or unexpected:
        msg = (
            f"the description of a kernel of type {kind.type_name!r} "
            f"lacks {sorted(missing)} and has the unexpected {sorted(unexpected)}; "
            f"it holds {sorted(field.name for field in known)}"
        )
        raise InputError(msg)

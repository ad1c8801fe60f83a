"""What is wrong with a document that somebody wrote, in words that fit any file format.

Keys are named as one finds them in the file: ``planes[0].x_mm.count``.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic import ValidationError
    from pydantic_core import ErrorDetails


_LONGEST = 60
"""Characters of a value that a message quotes."""

_EXPECTED: Mapping[str, str] = {
    "bool_type": "true or false",
    "dict_type": "keys with values",
    "finite_number": "a finite number",
    "float_parsing": "a number",
    "float_type": "a number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number from {ge:g} up",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "int_type": "a whole number",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number up to {le:g}",
    "list_type": "a list",
    "literal_error": "{expected}",
    "model_type": "keys with values",
    "string_pattern_mismatch": "a text of the form {pattern}",
    "string_type": "a text",
    "too_long": "up to {max_length} entries",
    "too_short": "{min_length} or more entries",
    "tuple_type": "a list",
}
"""What a value had to be, by the kind of pydantic's complaint, with the numbers it gives."""

_NUMBERS = {"float_parsing", "float_type", "int_parsing", "int_type"}


def faults(error: ValidationError, raw: object) -> str:
    """Return what a document's validation found, key by key.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    raw : object
        The data that it looked at, as the file's parser gave them.
    """
    return "; ".join(_fault(details, raw) for details in error.errors())


def written(value: object) -> str:
    """Return a value nearly as a file has it, cut off where it is long."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _fault(details: ErrorDetails, raw: object) -> str:
    key = _path(details, raw)
    match details["type"]:
        case "missing":
            return f"key {key!r} is missing"
        case "extra_forbidden":
            return f"key {key!r} is unknown"
        case "json_invalid":
            return f"it cannot be read ({details['ctx']['error']})"
        case kind:
            expected = _EXPECTED.get(kind, kind).format(**details.get("ctx", {}))
            return f"key {key!r}: expected {expected}, got {_got(kind, details['input'])}"


def _path(details: ErrorDetails, raw: object) -> str:
    """Return a key as the file has it; where it may be one of several things, pydantic says which.

    Such a choice is no key of the file, so the path is followed through the data.
    """
    path = ""
    for step in details["loc"]:
        if isinstance(step, int):
            path += f"[{step}]"
            raw = raw[step] if isinstance(raw, (list, tuple)) and step < len(raw) else None
        elif isinstance(raw, dict) and step in raw:
            path += f".{step}"
            raw = raw[step]
    if details["type"] == "missing":
        path += f".{details['loc'][-1]}"
    return path.removeprefix(".")


def _got(kind: str, value: Any) -> str:
    if kind in {"too_short", "too_long"}:
        return str(len(value))
    text = written(value)
    if kind in _NUMBERS and isinstance(value, str) and _is_number(value):
        return f"the text {text}; leave out the quotation marks"
    return text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True

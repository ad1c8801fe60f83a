"""Units in the headers of tables: how they are spelled, and what they are in mm, ms and degrees."""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from exposight.files.safe_texts import LONGEST_NAME

Quantity = Literal["length", "time", "angle", "share", "count", "text", "none"]
"""What a column holds; "none" is a number without a unit."""

_SPELLED: Mapping[str, Mapping[str, tuple[float, str]]] = MappingProxyType(
    {
        "length": {
            "mm": (1.0, "mm millimeter millimeters millimetre millimetres"),
            "cm": (10.0, "cm centimeter centimeters centimetre centimetres"),
            "m": (1000.0, "m meter meters metre metres"),
            "um": (0.001, "um micron microns micrometer micrometers micrometre micrometres"),
            "inch": (25.4, "in inch inches zoll \" ''"),
        },
        "time": {
            "ms": (1.0, "ms msec msecs millisecond milliseconds"),
            "us": (0.001, "us usec usecs microsecond microseconds"),
            "s": (1000.0, "s sec secs second seconds"),
            "ns": (1e-6, "ns nsec nanosecond nanoseconds"),
        },
        "angle": {
            "deg": (1.0, "deg degs degree degrees °"),
            "rad": (57.29577951308232, "rad rads radian radians"),
            "mrad": (0.05729577951308232, "mrad"),
        },
        "share": {"": (1.0, "1"), "%": (0.01, "% percent pct")},
    }
)
UNITS: Mapping[str, Mapping[str, tuple[str, float]]] = MappingProxyType(
    {
        quantity: {
            word: (unit, factor)
            for unit, (factor, words) in units.items()
            for word in words.split()
        }
        for quantity, units in _SPELLED.items()
    }
)
"""Of each quantity how units are spelled, the unit and its factor to the canonical one."""

CANONICAL = {"length": "mm", "time": "ms", "angle": "deg"}
ANSWERED = {"length": "unit", "time": "exposure", "angle": "angle"}
"""The entry of `Reading` that tells the unit of columns that do not."""

_MICRO = str.maketrans({"µ": "u", "μ": "u", "⌀": "ø", "∅": "ø", "″": '"', "”": '"'})
_BRACKETED = re.compile(r"^(.*?)\s*[\[(<{]\s*([^\])>}]*?)\s*[\])>}]\s*$")
_TRAILING = re.compile(
    r"^(.+?)(?:\s*/\s*|\s+in\s+|[\s_.,]+(?:in[\s_]+)?)([^\s_/,]+)$", re.IGNORECASE
)
_SYMBOL = re.compile(r"^(.*\S)\s*([°%])$")

_LONGEST = LONGEST_NAME
"""Characters of a name that is searched for a unit, which takes time with its square."""


def is_bracketed(name: str) -> bool:
    """Return whether a name ends with something in brackets, which must be its unit."""
    return len(name) <= _LONGEST and _BRACKETED.match(name.strip()) is not None


def stems_and_units(name: str) -> list[tuple[str, str]]:
    """Return how a name may be made of a stem and a unit."""
    plain = name.strip().translate(_MICRO)
    if len(plain) > _LONGEST:
        return []
    made = []
    for pattern in (_BRACKETED, _SYMBOL, _TRAILING):
        match = pattern.match(plain)
        if match:
            made.append((match[1], match[2].strip().lower()))
    return made


def plain_name(name: str) -> str:
    """Return a name without what its spellings differ by."""
    return re.sub(r"[\W_]", "", name.translate(_MICRO).lower())


def is_unit(cell: str) -> bool:
    """Return whether a cell is a unit, in brackets or not; dashes stand for none."""
    bare = cell.strip().strip("[]()").strip().translate(_MICRO).lower()
    return bare in {"", "-", "1"} or any(bare in units for units in UNITS.values())

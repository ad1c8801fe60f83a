"""Circles and slots of DMIS programs (ISO 22093), as nominal features of a part."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from exposight.cell.feature_lists.listed_features import ListFaults, left_out, listed_feature
from exposight.cell.part import Feature, FeatureKind
from exposight.errors import ExposightError, FeatureError, FormatError
from exposight.files import UNITS_MM, Reading, recognised
from exposight.files.text_tables.encodings import decode

_UNITS_MM = {name.upper(): scale for name, scale in UNITS_MM.items()} | {"IN": 25.4, "FEET": 304.8}
_ANGLES = ("ANGDEC", "ANGDMS", "ANGRAD")
_PLANES = {"XYPLAN": (0, 1, 2), "YZPLAN": (1, 2, 0), "ZXPLAN": (2, 0, 1), "XZPLAN": (2, 0, 1)}
"""Axes of r cos a, r sin a and the height of polar coordinates, of each working plane."""

_DMIS = re.compile(rb"=\s*FEAT\s*/|^\s*DMISMN\s*/|^\s*UNITS\s*/", re.IGNORECASE | re.MULTILINE)
_FEATURE = re.compile(r"F\s*\(\s*([^()]+?)\s*\)\s*=\s*FEAT\s*/\s*(.+)", re.IGNORECASE)
_STATEMENT = re.compile(r"(?:\w+\s*\([^()]*\)\s*=\s*)?(\w+)\s*/?\s*(.*)")
_MOVES = frozenset({"DATSET", "TRANS", "ROTATE"})
"""Statements after which coordinates are in another system."""


@dataclass(kw_only=True)
class _State:
    """What statements before a feature have set."""

    unit_mm: float | None = None
    angle: str = "ANGDEC"
    plane: str = "XYPLAN"
    moved_at: int = 0


@dataclass(kw_only=True)
class _Read:
    """What was read of a program; systems are the lines that set each feature's coordinates."""

    features: list[Feature] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)
    systems: list[int] = field(default_factory=list)
    left: dict[str, int] = field(default_factory=dict)


def is_dmis(data: bytes) -> bool:
    """Tell by its statements whether a text is a DMIS program."""
    return _DMIS.search(data.replace(b"\0", b"")) is not None  # also in UTF-16


def features_from_dmis(data: bytes, path: Path, reading: Reading) -> tuple[Feature, ...]:
    """Return the circles and slots that a DMIS program defines.

    Inner circles become holes, inner closed parallel features slots (``ROUND``) or pockets with
    sharp corners (``FLAT``), spheres with a direction spheres. Vectors are taken for outward
    normals, unless `reading` says that they are inward.

    Parameters
    ----------
    data : bytes
        The whole program.
    path : Path
        Its name, for messages.
    reading : Reading
        Its ``unit`` counts where the program has no ``UNITS``.

    Raises
    ------
    FormatError, FeatureError
        With all faults at once; also where it defines no such feature, or some before and some
        after coordinates are moved.
    """
    state, read = _State(), _Read()
    if reading.unit is not None:
        state.unit_mm = UNITS_MM[reading.unit]
    faults = ListFaults(path)
    without_unit = False
    text, _ = decode(data, path, reading.encoding)
    for row, statement in _statements(text):
        found = _FEATURE.fullmatch(statement)
        if found is None:
            _set(state, row, statement, path)
            continue
        name, words = found[1], [word.strip() for word in found[2].split(",")]
        try:
            feature = _feature(name, words, state, inward=reading.normals == "inward")
        except ExposightError as error:
            faults.add(f"row {row}, feature {name!r}", error)
            continue
        if feature is None:
            side = [word.upper() for word in words[1:2] if word.upper() in {"INNER", "OUTER"}]
            what = " ".join([words[0].upper(), *side])
            read.left[what] = read.left.get(what, 0) + 1
            continue
        without_unit |= state.unit_mm is None
        read.features.append(feature)
        read.names.append(name)
        read.rows.append(row)
        read.systems.append(state.moved_at)
    faults.add_repeated(read.names, read.rows)
    faults.settle()
    _check(read, path, is_pc_dmis=b"THEO/" in data)
    remarks = ["DMIS program"]
    if without_unit:
        remarks.append("taken as mm, for it has no UNITS")
    elif state.unit_mm != 1.0:
        remarks.append("lengths converted to mm")
    if any(read.systems):
        remarks.append(f"in the coordinates that row {read.systems[0]} sets")
    if read.left:
        remarks.append(f"not read: {left_out(read.left)}")
    if reading.normals == "inward":
        remarks.append("normals turned outward, as told")
    recognised(path, *remarks)
    return tuple(read.features)


def _check(read: _Read, path: Path, *, is_pc_dmis: bool) -> None:
    """Check that there are features, all in one system of coordinates."""
    if not read.features:
        left = left_out(read.left) or "none at all"
        msg = f"{path}: expected features FEAT/CIRCLE,INNER or FEAT/CPARLN,INNER, got {left}; " + (
            "this is a program of PC-DMIS: export it as DMIS, or its features as a table"
            if is_pc_dmis
            else "nothing to measure rings about"
        )
        raise FeatureError(msg)
    changed = next(
        (k for k in range(1, len(read.systems)) if read.systems[k] != read.systems[0]), 0
    )
    if changed:
        msg = (
            f"{path}: the statement in row {read.systems[changed]} moves the coordinates between "
            f"feature {read.names[0]!r} and feature {read.names[changed]!r}; export all features "
            "in one system of coordinates, the part's"
        )
        raise FormatError(msg)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield statements with the row that they begin in: no comments, continued lines joined."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    begun, start = "", 0
    for row, line in enumerate(text.split("\n"), start=1):
        bare = line.split("$$", 1)[0].strip()
        if not begun:
            start = row
        if bare.endswith("$"):
            begun += bare[:-1].rstrip()
            continue
        statement, begun = begun + bare, ""
        if statement:
            yield start, statement
    if begun:
        yield start, begun


def _set(state: _State, row: int, statement: str, path: Path) -> None:
    """Take over what a statement sets for the features that follow."""
    found = _STATEMENT.fullmatch(statement)
    if found is None:
        return
    word, rest = found[1].upper(), [each.strip().upper() for each in found[2].split(",")]
    if word == "UNITS":
        if rest[0] not in _UNITS_MM:
            msg = f"{path}, row {row}: expected UNITS/{' or '.join(_UNITS_MM)}, got {rest[0]!r}"
            raise FormatError(msg)
        state.unit_mm = _UNITS_MM[rest[0]]
        state.angle = next((each for each in rest[1:] if each in _ANGLES), "ANGDEC")
    elif word == "WKPLAN" and rest[0] in _PLANES:
        state.plane = rest[0]
    elif word == "DATSET" and rest[0] == "MCS":
        state.moved_at = 0
    elif word in _MOVES or (word == "RECALL" and re.match(r"DA?\s*\(", rest[0])):
        state.moved_at = row


def _feature(name: str, words: Sequence[str], state: _State, *, inward: bool) -> Feature | None:
    """Return the feature of a definition, None where it is of another kind."""
    what = words[0].upper()
    flags = [word.upper() for word in words[1:4]]
    if what not in {"CIRCLE", "CPARLN", "SPHERE"} or (what != "SPHERE" and "INNER" not in flags):
        return None
    system = next((k for k, flag in enumerate(flags) if flag in {"CART", "POL"}), None)
    if system is None:
        msg = f"expected CART or POL coordinates, got {','.join(words)}"
        raise FormatError(msg)
    values = list(words[2 + system :])
    place = _place(values[:3], flags[system], state)
    numbers = _numbers(values[3:])
    scale = state.unit_mm or 1.0
    if what == "SPHERE":
        if len(numbers) < 4:
            return None  # from where it is seen is not known
        numbers = [*numbers[1:4], numbers[0]]
    needed = 8 if what == "CPARLN" else 4
    got = [value for value in numbers[:needed] if math.isfinite(value)]
    if len(place) < 3 or len(got) < needed:
        msg = f"expected {3 + needed} numbers, got {','.join(values)}"
        raise FormatError(msg)
    normal, direction = np.array(numbers[:3]), None
    kind: FeatureKind = "sphere" if what == "SPHERE" else "hole"
    length = width = None
    radius = numbers[3] / 2
    if what == "CPARLN":
        kind = "pocket" if "FLAT" in flags else "slot"
        direction, (length, width) = np.array(numbers[3:6]), numbers[6:8]
        radius = 0.0 if kind == "pocket" else width / 2
    return listed_feature(
        name=name,
        kind=kind,
        place_mm=scale * place,
        normal=0.0 - normal if inward else normal,
        direction=direction,
        radius_mm=scale * radius,
        length_mm=None if length is None else scale * length,
        width_mm=None if width is None else scale * width,
    )


def _place(words: Sequence[str], system: str, state: _State) -> NDArray[np.float64]:
    """Return Cartesian coordinates, in the program's unit."""
    if system == "CART":
        return np.array([value for value in _numbers(words) if math.isfinite(value)])
    if len(words) < 3:
        return np.zeros(0)
    (radius, height), angle = _numbers([words[0], words[2]]), _angle(words[1], state.angle)
    if not math.isfinite(radius + height + angle):
        return np.zeros(0)
    place = np.zeros(3)
    place[list(_PLANES[state.plane])] = radius * math.cos(angle), radius * math.sin(angle), height
    return place


def _angle(word: str, notation: str) -> float:
    """Return an angle in radians; NaN where it is no number."""
    if notation == "ANGDMS" and ":" in word:
        parts = _numbers([part.strip("-+ ") for part in word.split(":")])
        degrees = sum(part / 60**k for k, part in enumerate(parts))
        return math.radians(-degrees if word.strip().startswith("-") else degrees)
    (value,) = _numbers([word])
    return value if notation == "ANGRAD" else math.radians(value)


def _numbers(words: Sequence[str]) -> list[float]:
    """Return numbers, NaN for what is none."""
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            values.append(math.nan)
    return values

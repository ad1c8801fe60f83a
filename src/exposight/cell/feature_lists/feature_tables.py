"""Lists of features as people keep them: any dialect, any order, their own words and units."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from exposight.cell.feature_lists.feature_words import (
    COLUMNS,
    KINDS,
    NAMES,
    all_but_the_first,
    kind_of,
    known_columns,
)
from exposight.cell.feature_lists.listed_features import ListFaults, listed_feature
from exposight.cell.part import RULES, Feature, FeatureKind
from exposight.errors import ExposightError, FeatureError, FormatError
from exposight.files.reading import Reading, ambiguous, current_reading, recognised
from exposight.files.safe_texts import unguarded
from exposight.files.text_tables.columns import Matched, match_columns
from exposight.files.text_tables.dialects import TextTable, parse_table
from exposight.files.text_tables.encodings import decode
from exposight.files.text_tables.written_numbers import is_plain
from exposight.tables import counted

_SCALED = (0.5, 1.8)
"""Lengths of what is a direction that somebody did not scale to 1, such as (1, 1, 0)."""
_ALIKE = 0.02
_MOST_ABOVE = 30
"""Lines among which the names of the columns are looked for."""
_KEPT_ABOVE = re.compile(r"\s*(?:#|//|%|\"?sep=)", re.IGNORECASE)
"""Comments, and the line that tells the separator."""
_DASHES = re.compile(r"\s*\|?\s*:?-{3,}[-:|\s]*")
_FEWEST = 3
_NORMAL = ("nx", "ny", "nz")
_AXIS_WORD = re.compile(r"([+-]?)\s*([xyz])\s*([+-]?)")
_NO_NORMALS = (
    "it has no normals: add the columns nx, ny, nz of the outward surface normal at each feature; "
    "from the part's mesh `exposight part` takes them"
)


@dataclass(frozen=True, kw_only=True)
class _Columns:
    """Which columns a list has, and what was recognised."""

    table: TextTable
    matched: Mapping[str, Matched]
    remarks: list[str]

    def texts(self, name: str) -> list[str]:
        column = self.matched.get(name)
        return (
            [""] * len(self.table)
            if column is None
            else list(map(unguarded, self.table.texts(column.index)))
        )

    def numbers(self, *names: str) -> dict[str, NDArray[np.float64]]:
        """Return columns in mm, NaN where a cell is empty or there is no such column."""
        there = [name for name in names if name in self.matched]
        values = self.table.numbers(*(self.matched[name].index for name in there))
        columns = np.atleast_2d(values.T if values.ndim == 2 else values)
        read = {
            name: self.matched[name].factor * column
            for name, column in zip(there, columns, strict=True)
        }
        return {name: read.get(name, np.full(len(self.table), np.nan)) for name in names}


def features_from_table(
    data: bytes, path: Path, reading: Reading | None = None
) -> tuple[Feature, ...]:
    """Return the features of a text table; see `exposight.cell.read_features`.

    Raises
    ------
    FormatError, FeatureError
        With all faults of the list at once, the first ten of them told.
    AmbiguousError
        If two readings fit equally well: a size that is a radius or a diameter, say.
    """
    reading = current_reading(reading)
    data, above = _from_header(data, path, reading)
    table = parse_table(data, path, what="feature list", reading=reading, least=4)
    columns = _recognised(table, path, reading)
    columns.remarks.extend(above)
    if not len(table):
        msg = f"{path} lists no feature; expected at least one row under its header"
        raise FeatureError(msg)
    names = columns.texts("name")
    if "name" not in columns.matched:
        names = [str(n) for n in range(1, len(table) + 1)]
        columns.remarks.append("no names: features are called by their number")
    numbers = _worded_normals(columns) | columns.numbers(
        *("x_mm", "y_mm", "z_mm", "radius_mm", "diameter_mm", "size_mm", "length_mm", "width_mm"),
        *("tx", "ty", "tz", *(() if "normal" in columns.matched else _NORMAL)),
    )
    kinds = _kinds(columns, numbers)
    radii = _radii(columns, numbers, names, path, reading)
    normals = _normals(columns, numbers, reading)
    finishes = columns.texts("finish")
    features, faults = list[Feature](), ListFaults(path)
    rows = [f"row {table.lines[row]}, feature {name!r}" for row, name in enumerate(names)]
    faults.add_stand_ins(numbers, rows)
    for row, name in enumerate(names):
        try:
            features.append(
                _feature(
                    name, kinds[row], float(radii[row]), normals[row], finishes[row],
                    {key: float(values[row]) for key, values in numbers.items()},
                )
            )  # fmt: skip
        except ExposightError as error:
            faults.add(rows[row], error)
    faults.add_repeated(names, table.lines)
    faults.settle()
    recognised(path, *table.remarks, *columns.remarks)
    return tuple(features)


def _from_header(data: bytes, path: Path, reading: Reading) -> tuple[bytes, list[str]]:
    """Return a table without a title above its names, and without Markdown's line of dashes."""
    text, encoding = decode(data, path, reading.encoding)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    start = 0
    for place, line in enumerate(lines[:_MOST_ABOVE]):
        cells = [cell.strip().strip('"') for cell in re.split(r"[;,|\t]", line)]
        if len(known_columns(cells) & {"x_mm", "y_mm", "z_mm"}) == 3:
            start = place
            break
    dashes = [k for k, line in enumerate(lines[: start + 2]) if _DASHES.fullmatch(line)]
    above = [
        k
        for k, line in enumerate(lines[:start])
        if line.strip(' ;,|\t"') and not _KEPT_ABOVE.match(line)
    ]
    if not dashes and not above:
        return data, []
    kept = ["" if k in above or k in dashes else line for k, line in enumerate(lines)]
    said = [f"{counted(len(above), 'line')} above the names left out"] if above else []
    said += [f"characters in {encoding}"] if encoding != "utf-8" else []
    return "\n".join(kept).encode(reading.encoding or "utf-8"), said


def _recognised(table: TextTable, path: Path, reading: Reading) -> _Columns:
    """Match the columns; of several that hold names or kinds the best is taken."""
    header = list(table.header)
    remarks = []
    for names in (NAMES, KINDS):
        for place in all_but_the_first(header, names):
            header[place] = ""
    # A single column may hold the whole normal.
    single = "normal" in known_columns(header) and not set(_NORMAL) & known_columns(header)
    wanted = [c for c in COLUMNS if c.name not in _NORMAL] if single else COLUMNS[:-1]
    try:
        matched = match_columns(header, wanted, path, reading)
    except FormatError as error:
        if "nx, ny, nz" in str(error):
            msg = f"{error}; {_NO_NORMALS}"
            raise FormatError(msg) from error
        raise
    if {"radius_mm", "diameter_mm"} & matched.keys():
        matched.pop("size_mm", None)  # which of them it is does not matter
    unitless = [m.header for m in matched.values() if m.remark.endswith("has no unit")]
    remarks += [m.remark for m in matched.values() if m.remark and m.header not in unitless]
    if unitless:
        remarks.append(f"{', '.join(unitless)} taken as mm, for the header has no unit")
    used = {m.index for m in matched.values()}
    left = [name for k, name in enumerate(table.header) if k not in used and name]
    if left:
        remarks.append(f"not read: {', '.join(left)}")
    return _Columns(table=table, matched=matched, remarks=remarks)


def _kinds(
    columns: _Columns, numbers: Mapping[str, NDArray[np.float64]]
) -> list[FeatureKind | str]:
    """Return the kind of each row; the word itself where it means none."""
    if "kind" not in columns.matched:
        if np.isfinite(numbers["length_mm"]).any():
            msg = (
                f"{columns.table.source}: missing column kind: some features have a length, so not "
                f"all are holes; say of each which of {', '.join(RULES)} it is"
            )
            raise FormatError(msg)
        columns.remarks.append("no kinds: all taken for holes")
        return ["hole"] * len(columns.table)
    kinds: list[FeatureKind | str] = []
    words: dict[str, str] = {}
    for word in columns.texts("kind"):
        kind = kind_of(word)
        if kind is not None and kind != word.lower():
            words[word] = kind
        kinds.append(kind or word)
    columns.remarks.extend(f"{word} is {kind}" for word, kind in words.items())
    return kinds


def _radii(
    columns: _Columns,
    numbers: Mapping[str, NDArray[np.float64]],
    names: Sequence[str],
    path: Path,
    reading: Reading,
) -> NDArray[np.float64]:
    """Return the radius of each feature, mm; NaN where there is none."""
    radii, diameters = numbers["radius_mm"].copy(), numbers["diameter_mm"]
    sized = "size_mm" in columns.matched
    if not sized and "radius_mm" not in columns.matched and "diameter_mm" not in columns.matched:
        if np.isfinite(numbers["width_mm"]).all():
            return radii
        header = ", ".join(map(repr, columns.table.header))
        msg = (
            f"{path}: missing column radius_mm, or diameter_mm (its columns are {header}); the "
            "size of each feature is needed"
        )
        raise FormatError(msg)
    if "diameter_mm" in columns.matched:
        halved = 0.5 * diameters
        given = np.isfinite(radii) & np.isfinite(halved)
        off = given & ~np.isclose(radii, halved, rtol=1e-3)
        if off.any():
            row = int(np.flatnonzero(off)[0])
            msg = (
                f"{path}, row {columns.table.lines[row]}, feature {names[row]!r}: the radius "
                f"{radii[row]:g} is not half the diameter {diameters[row]:g}; leave one column out"
            )
            raise FeatureError(msg)
        if np.isfinite(halved).any():
            columns.remarks.append(f"{columns.matched['diameter_mm'].header} halved to radius_mm")
        radii = np.where(np.isfinite(radii), radii, halved)
    elif sized and "radius_mm" not in columns.matched:
        sizes = numbers["size_mm"]
        header = columns.matched["size_mm"].header
        if reading.size is None:
            row = int(np.flatnonzero(np.isfinite(sizes))[0]) if np.isfinite(sizes).any() else 0
            name, size = names[row], float(sizes[row])
            raise ambiguous(
                path,
                f"is {header!r} a radius or a diameter?",
                "size",
                {
                    "radius": f"{name} has a radius of {size:g} mm",
                    "diameter": f"{name} has a radius of {size / 2:g} mm",
                },
            )
        columns.remarks.append(f"{header} is a {reading.size}, as told")
        radii = 0.5 * sizes if reading.size == "diameter" else sizes
    return radii


def _worded_normals(columns: _Columns) -> dict[str, NDArray[np.float64]]:
    """Return the normals of a column that holds them whole: ``+Z``, ``-x``, ``0 0 1``."""
    if "normal" not in columns.matched:
        return {}
    vectors = np.full((len(columns.table), 3), np.nan)
    for row, word in enumerate(columns.texts("normal")):
        axis = _AXIS_WORD.fullmatch(word.lower())
        if axis is not None:
            vectors[row] = 0.0
            vectors[row, "xyz".index(axis[2])] = -1.0 if "-" in (axis[1], axis[3]) else 1.0
            continue
        numbers = re.split(r"[\s;,|]+", word.strip(" ()[]{}<>"))
        if len(numbers) == 3 and all(is_plain(number, "point") for number in numbers):
            vectors[row] = [float(number) for number in numbers]
    columns.remarks.append(f"{columns.matched['normal'].header} is the whole normal")
    return {name: vectors[:, k] for k, name in enumerate(_NORMAL)}


def _normals(
    columns: _Columns, numbers: Mapping[str, NDArray[np.float64]], reading: Reading
) -> NDArray[np.float64]:
    """Return the outward normals, (n, 3); of length 1 where they are clearly directions."""
    normals = np.stack([numbers["nx"], numbers["ny"], numbers["nz"]], axis=-1)
    lengths = np.linalg.norm(normals, axis=1)
    known = np.isfinite(lengths) & (lengths > 0.0)
    off = known & (np.abs(lengths - 1.0) > 1e-3)
    if off.any():
        low, high = float(lengths[known].min()), float(lengths[known].max())
        alike = known.all() and len(lengths) >= _FEWEST and high - low <= _ALIKE * low
        scaled = off & (alike | ((lengths >= _SCALED[0]) & (lengths <= _SCALED[1])))
        if scaled.any():
            normals[scaled] /= lengths[scaled, None]
            columns.remarks.append("normals scaled to length 1")
    if reading.normals == "inward":
        normals = 0.0 - normals
        columns.remarks.append("normals turned outward, as told")
    return normals


def _feature(
    name: str,
    kind: str,
    radius_mm: float,
    normal: NDArray[np.float64],
    finish: str,
    numbers: Mapping[str, float],
) -> Feature:
    """Return the feature of a row; FeatureError if a number is missing or makes no sense."""
    long = kind in RULES and RULES[cast("FeatureKind", kind)].has_length
    length, width = numbers["length_mm"], numbers["width_mm"]
    if kind == "slot" and math.isfinite(width) and not math.isfinite(radius_mm):
        radius_mm = width / 2
    elif kind == "slot" and math.isfinite(radius_mm) and not math.isfinite(width):
        width = 2 * radius_mm
    needed = {axis: numbers[axis] for axis in ("x_mm", "y_mm", "z_mm")}
    needed |= dict(zip(_NORMAL, normal.tolist(), strict=True)) | {"radius_mm": radius_mm}
    missing = [column for column, value in needed.items() if not math.isfinite(value)]
    if missing and kind in RULES:
        msg = f"column {', '.join(missing)}: expected a number, got none"
        raise FeatureError(msg)
    direction = np.array([numbers[axis] for axis in ("tx", "ty", "tz")])
    return listed_feature(
        name=name,
        kind=kind,
        place_mm=np.array([numbers[axis] for axis in ("x_mm", "y_mm", "z_mm")]),
        normal=normal,
        direction=direction if np.isfinite(direction).any() else None,
        radius_mm=radius_mm,
        # Of what has neither, 0 is as good as an empty cell.
        length_mm=length if math.isfinite(length) and (length or long) else None,
        width_mm=width if math.isfinite(width) and (width or long) else None,
        finish=finish,
    )

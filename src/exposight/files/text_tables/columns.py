"""The columns of a text table: which are expected, which came, and in which unit."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path

from exposight.errors import FormatError
from exposight.files.reading import Reading, ambiguous, current_reading
from exposight.files.text_tables.column_units import (
    ANSWERED,
    CANONICAL,
    UNITS,
    Quantity,
    is_bracketed,
    is_unit,
    plain_name,
    stems_and_units,
)

_SHOWN = 16
"""Columns that a message lists."""

_SLIP = 0.85
"""Likeness of a slip: one letter of seven."""

_KNOWN_STEMS = (
    "x y z i j k u v w p r a b c g red green blue nx ny nz normalx normaly normalz tx ty tz rx ry "
    "rz qx qy qz qw intensity name kind type row col column feature view exposure radius diameter "
    "index"
)


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """A column that a table may have.

    Parameters
    ----------
    name : str
        As our own files name it, with its canonical unit: ``x_mm``.
    aliases : tuple of str
        Other names, whatever their capitals, blanks and underscores. Units are not part of them:
        ``t_exp`` is also found as ``t_exp [µs]``.
    quantity : str
        What its values are; its canonical unit is mm, ms or deg, and shares are 0–1.
    required : bool
        Whether the table must have it.
    bare : bool
        Whether its name without the unit is one of its names, too.
    """

    name: str
    aliases: tuple[str, ...] = ()
    quantity: Quantity = "none"
    required: bool = True
    bare: bool = True


@dataclass(frozen=True, kw_only=True)
class Matched:
    """A column that a table has.

    Parameters
    ----------
    index : int
        Its place, from 0.
    header : str
        Its name in the file.
    factor : float
        What its numbers are multiplied by for the canonical unit.
    unit : str or None
        Its unit in the file; None where neither the file nor somebody tells it, and the canonical
        one was taken.
    remark : str
        What was recognised; empty where it is named as in our own files.
    assumed : bool
        Whether its unit is the field's own because nobody tells another.
    """

    index: int
    header: str
    factor: float = 1.0
    unit: str | None = None
    remark: str = ""
    assumed: bool = False


def match_columns(
    header: Sequence[str],
    wanted: Sequence[Wanted],
    source: str | Path,
    reading: Reading | None = None,
    *,
    further: bool = True,
) -> dict[str, Matched]:
    """Return which columns of a table are wanted ones, by their names, and their units.

    A length, time or angle whose header has no unit has the one that `reading` tells, else mm, ms
    or degrees, the field's own, which is said. It is asked where other lengths of the table have
    another unit than mm.

    Parameters
    ----------
    header : sequence of str
        The columns' names.
    wanted : sequence of Wanted
    source : str or Path
        For messages.
    reading : Reading, optional
    further : bool
        Whether there may be columns that are not wanted; those whose names are nearly a wanted one
        that is not there are refused anyway.

    Returns
    -------
    dict of str to Matched
        By their names in `wanted`, in its order.

    Raises
    ------
    FormatError
        With all faults at once: columns that are missing, twice there, or in a strange unit.
    AmbiguousError
        If a column's unit may be that of others.
    """
    reading = current_reading(reading)
    by_stem = _by_stem(wanted)
    found: dict[str, list[tuple[int, str | None]]] = {}
    unknown: list[str] = []
    faults: list[str] = []
    for place, name in enumerate(header):
        match = _match(name, by_stem)
        if match is None:
            unknown.append(name)
            faults += _foreign(name, by_stem)
            continue
        column, unit = match
        found.setdefault(column.name, []).append((place, unit))
    faults += _unfound(header, wanted, found, unknown, further=further)
    for name, places in found.items():
        if len(places) > 1:
            twice = " and ".join(f"{header[place]!r}" for place, _ in places)
            faults.append(f"{twice} are both {name}: leave one out")
    if faults:
        shown = ", ".join(map(repr, header[:_SHOWN])) + (", …" if len(header) > _SHOWN else "")
        msg = f"{source}: {'; '.join(faults)} (its columns are {shown})"
        raise FormatError(msg)
    return {
        column.name: _matched(column, header, *found[column.name][0], reading)
        for column in wanted
        if column.name in found and _unit_told(column, found, wanted, header, source, reading)
    }


def remarks_on(matched: Mapping[str, Matched]) -> tuple[str, ...]:
    """Return what to say of matched columns, those of one kind together."""
    kinds: dict[str, list[tuple[str, str]]] = {}
    for name, column in matched.items():
        if column.remark:
            how = "read as" if column.factor == 1.0 else "converted to"
            if column.assumed:
                how = "without a unit taken as"
            kinds.setdefault(how, []).append((column.header, name))
    return tuple(
        f"{', '.join(header for header, _ in pairs)} {how} {', '.join(name for _, name in pairs)}"
        for how, pairs in kinds.items()
    )


def _by_stem(wanted: Sequence[Wanted]) -> dict[tuple[str, str | None], Wanted]:
    """Return the wanted columns by plain stem, and "unit" where it needs one."""
    known: dict[tuple[str, str | None], Wanted] = {}
    for column in wanted:
        for name in (column.name, *column.aliases):
            known.setdefault((plain_name(name), None), column)
            for stem, unit in stems_and_units(name):
                if unit in UNITS.get(column.quantity, {}):
                    known.setdefault((plain_name(stem), None if column.bare else "unit"), column)
    return known


def _match(
    name: str, known: Mapping[tuple[str, str | None], Wanted]
) -> tuple[Wanted, str | None] | None:
    """Return the wanted column that a header names, and its unit as it is written there."""
    for stem, unit in stems_and_units(name):
        column = known.get((plain_name(stem), None)) or known.get((plain_name(stem), "unit"))
        if column is not None and unit in UNITS.get(column.quantity, {}):
            return column, unit
    whole = [] if name.rstrip().endswith(("°", "%")) else [name]
    for stem in (
        *whole,
        *(stem for stem, unit in stems_and_units(name) if unit == "" or is_bracketed(name)),
    ):
        column = known.get((plain_name(stem), None))
        if column is not None:
            foreign = next(
                (unit for _, unit in stems_and_units(name) if is_bracketed(name) and unit), None
            )
            if foreign is not None and column.quantity in UNITS:
                continue  # a unit that the quantity does not have
            return column, None
    return None


def _foreign(name: str, known: Mapping[tuple[str, str | None], Wanted]) -> list[str]:
    """Return what is wrong with a name that is a wanted one with another quantity's unit."""
    for stem, unit in stems_and_units(name):
        column = known.get((plain_name(stem), None))
        strange = is_bracketed(name) or any(unit in units for units in UNITS.values())
        if column is not None and column.quantity in UNITS and strange:
            units = ", ".join(dict.fromkeys(own for own, _ in UNITS[column.quantity].values()))
            return [f"{name!r} has the unit {unit!r}, expected {column.name} or another of {units}"]
    return []


def _unfound(
    header: Sequence[str],
    wanted: Sequence[Wanted],
    found: Mapping[str, object],
    unknown: Sequence[str],
    *,
    further: bool,
) -> list[str]:
    """Return what is missing or unknown, with what may have been meant."""
    faults: list[str] = []
    absent = [column for column in wanted if column.name not in found]
    meant: set[str] = set()
    for name in unknown:
        likely = likely_column(name, [column.name for column in absent])
        hint = unit_hint(name, [column.name for column in absent])
        if likely:
            meant.add(likely)
            faults.append(f"unknown column {name!r}; did you mean {likely!r}?")
        elif hint:
            faults.append(f"column {hint}")
        elif not further:
            close = likely_column(name, [column.name for column in wanted], least=0.6)
            faults.append(
                f"unknown column {name!r}" + (f"; did you mean {close!r}?" if close else "")
            )
    missing = [c.name for c in absent if c.required and c.name not in meant]
    if missing:
        faults.insert(0, f"missing column{'s' * (len(missing) > 1)} {', '.join(missing)}")
    return faults


def likely_column(name: str, others: Sequence[str], least: float = _SLIP) -> str:
    """Return the column that a name seems to be a slip of; empty where it is another.

    Other digits are another column (``i_p25`` is not ``i_p05``), and so is one with a further word.
    """
    digits = re.sub(r"\D", "", name)
    scored = [
        (SequenceMatcher(None, plain_name(name), plain_name(other)).ratio(), other)
        for other in others
        if digits == re.sub(r"\D", "", other) and not name.lower().startswith(f"{other.lower()}_")
    ]
    ratio, other = max(scored, default=(0.0, ""))
    return other if ratio >= least and len(plain_name(name)) > 1 else ""


def _unit_told(
    column: Wanted,
    found: Mapping[str, Sequence[tuple[int, str | None]]],
    wanted: Sequence[Wanted],
    header: Sequence[str],
    source: str | Path,
    reading: Reading,
) -> bool:
    """Ask for the unit of a column that has none while others of its kind have a strange one."""
    question = ANSWERED.get(column.quantity)
    unit = found[column.name][0][1]
    if question is None or unit is not None or getattr(reading, question) is not None:
        return True
    units = UNITS[column.quantity]
    others = {
        units[told][0]: header[place]
        for each in wanted
        if each.quantity == column.quantity and each.name in found
        for place, told in found[each.name]
        if told is not None
    }
    strange = [each for each in others if each != CANONICAL[column.quantity]]
    if strange:
        name = header[found[column.name][0][0]]
        raise ambiguous(
            source,
            f"which unit has {name!r}, while {others[strange[0]]!r} has {strange[0]}?",
            question,
            {strange[0]: "as that", CANONICAL[column.quantity]: "as exposight's own files"},
        )
    return True


def _matched(
    column: Wanted, header: Sequence[str], place: int, unit: str | None, reading: Reading
) -> Matched:
    name = header[place]
    units = UNITS.get(column.quantity, {})
    canonical = CANONICAL.get(column.quantity, "")
    if unit is not None:
        own, factor = units[unit]
        remark = f"{name} {'is' if factor == 1.0 else 'converted to'} {column.name}"
        if plain_name(name) == plain_name(column.name) and factor == 1.0:
            remark = ""
        return Matched(index=place, header=name, factor=factor, unit=own, remark=remark)
    question = ANSWERED.get(column.quantity)
    answer = None if question is None else getattr(reading, question)
    if answer is not None:
        factor = units[answer][1]
        remark = f"{name} is {column.name}" + ("" if factor == 1.0 else f", given in {answer}")
        return Matched(index=place, header=name, factor=factor, unit=answer, remark=remark)
    if plain_name(name) == plain_name(column.name):
        return Matched(index=place, header=name, unit=canonical or None)
    remark = f"{name} is {column.name}" if name else ""
    if canonical:
        remark = f"{name} taken as {column.name}, for it has no unit"
    return Matched(index=place, header=name, remark=remark, assumed=bool(canonical))


def looks_like_names(line: str) -> bool:
    """Return whether a comment names columns: most of its words are such names."""
    words = [word for word in re.split(r"[\s;,|]+", line.strip()) if not is_unit(word)]
    stems = _KNOWN_STEMS.split()
    known = [
        any(
            plain_name(stem) in stems
            for stem in (word, *(stem for stem, _ in stems_and_units(word)))
        )
        for word in words
    ]
    return len(known) > 1 and 2 * sum(known) > len(known)


def unit_hint(column: str, known: Iterable[str]) -> str:
    """Return what to do about a column, such as ``x_m``, that is a known one but for its unit.

    Empty where it is something else; the known columns' names end with their units: ``x_mm``.
    """
    for name in known:
        stem, _, unit = name.rpartition("_")
        quantity = next((each for each, own in CANONICAL.items() if own == unit), None)
        if quantity is None or column == name:
            continue
        if column.lower() == stem.lower():
            return f"{column} has no unit: convert to {unit} if it is not, and name it {name}"
        other = column.lower().removeprefix(f"{stem.lower()}_")
        if other.replace("µ", "u") in UNITS[quantity] and other != unit:
            return f"{column} is in {other}: convert to {unit} and name it {name}"
    return ""

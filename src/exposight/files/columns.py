"""The header line of a CSV file: which columns are expected, which came, and in which unit."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from exposight.errors import FormatError

_UNITS: Mapping[str, frozenset[str]] = {
    "mm": frozenset({"m", "cm", "um", "µm", "in", "inch", "inches", "metre", "meter"}),
    "ms": frozenset({"s", "sec", "us", "µs", "ns", "min"}),
    "deg": frozenset({"rad", "mrad", "degree", "degrees"}),
}
"""Units of columns, each with others that it is mistaken for."""


def check_columns(
    received: Sequence[str],
    *,
    required: Sequence[str],
    optional: Sequence[str],
    source: Path,
) -> None:
    """Check the names of a CSV file's columns.

    Parameters
    ----------
    received : sequence of str
        The first line's cells.
    required : sequence of str
        Columns that must be there, in this order.
    optional : sequence of str
        Columns that may follow, in this order.
    source : Path
        The file, for messages.

    Raises
    ------
    FormatError
        If the columns are others. The message lists expected and received ones, and says which
        have another unit.
    """
    expected = [*required, *(column for column in optional if column in received)]
    if list(received) == expected:
        return
    spelled = ",".join(required) + "".join(f"[,{column}]" for column in optional)
    msg = f"{source}: expected the columns {spelled}, got {','.join(received)}"
    known = (*required, *optional)
    hints = [unit_hint(column, known) for column in received if column not in known]
    if len(received) == 1 and ";" in received[0]:
        hints = ["the columns are separated by semicolons: save the file with commas"]
    elif len(set(received)) == len(received) and set(received) == set(expected):
        hints = ["the columns are right and their order is not: sort them"]
    raise FormatError("; ".join([msg, *filter(None, hints)]))


def unit_hint(column: str, known: Iterable[str]) -> str:
    """Return what to do about a column that is a known one in another unit or without a unit.

    Parameters
    ----------
    column : str
        An unknown column, such as ``x_m``.
    known : iterable of str
        Known columns, whose names end with their units: ``x_mm``.

    Returns
    -------
    str
        Empty where the column is something else.
    """
    for name in known:
        stem, _, unit = name.rpartition("_")
        if unit not in _UNITS or column == name:
            continue
        if column.lower() == stem.lower():
            return f"{column} has no unit: convert to {unit} if it is not, and name it {name}"
        other = column.lower().removeprefix(f"{stem.lower()}_")
        if other in _UNITS[unit]:
            return f"{column} is in {other}: convert to {unit} and name it {name}"
    return ""

"""The header line of a CSV file: which columns are expected, which came, and in which unit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from exposight.errors import FormatError

if TYPE_CHECKING:
    from collections.abc import Sequence


_UNITS = {"m", "cm", "um", "µm", "in", "inch", "inches", "metre", "meter", "mm"}


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
        have another unit than mm.
    """
    expected = [*required, *(column for column in optional if column in received)]
    if list(received) == expected:
        return
    spelled = ",".join(required) + "".join(f"[,{column}]" for column in optional)
    msg = f"{source}: expected the columns {spelled}, got {','.join(received)}"
    hints = [_hint(column, (*required, *optional)) for column in received]
    if len(received) == 1 and ";" in received[0]:
        hints = ["the columns are separated by semicolons: save the file with commas"]
    elif len(set(received)) == len(received) and set(received) == set(expected):
        hints = ["the columns are right and their order is not: sort them"]
    raise FormatError("; ".join([msg, *filter(None, hints)]))


def _hint(column: str, known: Sequence[str]) -> str:
    """Say what is wrong with one column, where a unit is."""
    if column in known:
        return ""
    quantity, _, unit = column.rpartition("_")
    if unit.lower() in _UNITS and f"{quantity}_mm" in known:
        return f"{column} is in {unit}: convert to mm and name it {quantity}_mm"
    if f"{column.lower()}_mm" in known:
        return f"{column} has no unit: convert to mm if it is not, and name it {column.lower()}_mm"
    return ""

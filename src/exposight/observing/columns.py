"""What the columns of a table of observations must be, and what is said where they are not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.errors import FormatError, ObservationError, did_you_mean
from exposight.observing.masks import Visibility
from exposight.observing.observation import REQUIRED, SCHEMA

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


_UNIT_SUFFIXES = ("_ms", "_mm", "_deg")

_P_NORM_MAX = 10.0
"""A cloud denser than the image gives more than 1, but ten points a pixel are percent mistaken."""


def cast(path: Path, frame: pl.DataFrame, names: Sequence[str]) -> pl.DataFrame:
    """Give columns the types that they must have, or name the first value that has another."""
    try:
        return frame.select(pl.col(name).cast(SCHEMA[name]) for name in names)
    except pl.exceptions.PolarsError as error:
        msg = f"{path}: a column has values of the wrong type: {str(error).splitlines()[0]}"
        for name in names:
            if frame.schema[name] == pl.String and SCHEMA[name].is_numeric():
                numbers = frame[name].cast(SCHEMA[name], strict=False)
                wrong = frame[name].is_not_null() & numbers.is_null()
                if wrong.any():
                    row = int(np.flatnonzero(wrong.to_numpy())[0])
                    value = frame[name][row]
                    msg = (
                        f"{path}: values of the wrong type: column '{name}' needs numbers, row "
                        f"{row + 1} after the header has '{value}'"
                    )
                    if "," in value:
                        msg += "; write a point as decimal separator"
                    break
        raise FormatError(msg) from error


def check_header(
    path: Path, columns: Sequence[str], *, required: Sequence[str], closed: bool
) -> None:
    """Check that all required columns are there and, if closed, no unknown one."""
    missing = [name for name in required if name not in columns]
    unknown = [name for name in columns if name not in SCHEMA]
    if missing and {"name", "kind", "radius_mm"} <= set(columns):
        msg = (
            f"{path}: a list of a part's features, not observations of them; `exposight observe` "
            "makes a table of observations from a campaign"
        )
        raise FormatError(msg)
    for name in missing:
        stem = next((name.removesuffix(s) for s in _UNIT_SUFFIXES if name.endswith(s)), None)
        other = [u for u in unknown if stem and (u == stem or u.startswith(f"{stem}_"))]
        if other:
            msg = (
                f"{path}: column '{other[0]}' has another unit or none: expected '{name}'; "
                "convert the values and rename the column"
            )
            raise FormatError(msg)
    if missing and not closed:
        msg = f"{path}: missing columns {', '.join(missing)}; found {', '.join(columns)}"
        raise FormatError(msg)
    if closed and (missing or unknown):
        meant = [
            meant.replace("?", f" by {name!r}?")
            for name in unknown
            if (meant := did_you_mean(name, SCHEMA))
        ]
        msg = (
            f"{path}: wrong header: missing {missing or 'none'}, unknown {unknown or 'none'}; "
            f"expected {', '.join(SCHEMA)}, of which those after radius_mm may be left out"
            + "".join(meant)
        )
        raise FormatError(msg)


def missing_column(name: str) -> pl.Expr:
    """Return what stands in a column that a table leaves out."""
    if name == "visibility":
        return pl.lit(Visibility.VISIBLE.value).alias(name)
    if name == "emulated":
        return pl.lit(False).alias(name)
    if name == "incidence_deg":
        return pl.lit(np.nan).alias(name)
    return pl.lit(None, dtype=SCHEMA[name]).alias(name)


def check_whole(path: Path, frame: pl.DataFrame) -> None:
    """Refuse fractions in columns of whole numbers: casting would cut them off unseen."""
    for name, dtype in SCHEMA.items():
        if dtype.is_integer() and frame.schema[name].is_float():
            column = frame[name]
            _refuse(path, column, column != column.floor(), "whole numbers")


def check_values(path: Path, frame: pl.DataFrame) -> None:
    """Check that values are there where they must be, and within what they can be."""
    for name in (*REQUIRED, "visibility", "emulated"):
        if name not in {"p_norm", "i_avg"}:  # empty where a feature was not measured
            _refuse(path, frame[name], frame[name].is_null(), "a value in every row")
    for name, dtype in SCHEMA.items():
        if dtype.is_float() and name != "incidence_deg":  # NaN where the table has none
            _refuse(path, frame[name], ~frame[name].is_finite(), "finite numbers")
    _refuse(path, frame["exposure_ms"], frame["exposure_ms"] <= 0, "values above 0")
    _refuse(path, frame["radius_mm"], frame["radius_mm"] < 0, "values of at least 0")
    for name in ("i_avg", "i_median", "i_p05", "i_p95"):
        _refuse(path, frame[name], ~frame[name].is_between(0, 255), "grey levels 0–255")
    _refuse(
        path,
        frame["p_norm"],
        ~frame["p_norm"].is_between(0, _P_NORM_MAX),
        "a share, 0–1, of the ring's pixels (divide percent by 100)",
    )
    unlit = frame["p_norm"].is_not_null() & frame["i_avg"].is_null()
    _refuse(path, frame["i_avg"], unlit, "a value in every row that has a p_norm")
    reasons = [reason.value for reason in Visibility]
    unknown = ~frame["visibility"].is_in(reasons)
    _refuse(path, frame["visibility"], unknown, f"one of {', '.join(map(repr, reasons))}")


def _refuse(path: Path, column: pl.Series, bad: pl.Series, expected: str) -> None:
    """Refuse a column where `bad` is true; where it is null, there is no value to judge."""
    rows = np.flatnonzero(bad.fill_null(value=False).to_numpy())
    if rows.size == 0:
        return
    value = column[int(rows[0])]
    msg = (
        f"{path}: column '{column.name}' needs {expected}; row {rows[0] + 1} after the header "
        f"{'is empty' if value is None else f'has {value}'} ({rows.size} of {len(column)} "
        f"row{'' if len(column) == 1 else 's'} {'is' if rows.size == 1 else 'are'} wrong)"
    )
    raise ObservationError(msg)

"""The columns of an observation table: what they are, and what is refused in them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import get_args

import polars as pl

from exposight.cell import BrightnessSource
from exposight.errors import ExposightError, FormatError, ObservationError
from exposight.files import check_plain, likely_column, spelled, unit_hint
from exposight.files.safe_texts import has_control_characters
from exposight.observing.masks import Visibility


@dataclass(frozen=True, kw_only=True, slots=True)
class Observation:
    """One feature in one capture: a row of the table.

    Parameters
    ----------
    feature, view : str
        Names.
    exposure_ms : float, ms
        Exposure time (the paper's t_exp).
    p_norm : float or None
        Share of the ring's pixels that gave a 3D point (Eq. 5); None where not measured.
    i_avg : float or None
        Mean grey value of the ring, 0–255.
    x_mm, y_mm, z_mm : float, mm
        Position in the TCP frame.
    w_deg, p_deg, r_deg : float, degrees
        Orientation in the TCP frame.
    radius_mm : float, mm
        The feature's radius.
    n_points, n_pixels : int or None
        Points in the hollow cylinder (Eq. 4) and pixels of its ring (Eq. 6) on the cloud's own
        grid, which is the image's or a whole fraction of it.
    i_std, i_median, i_p05, i_p95 : float or None
        Spread of the ring's grey values, 0–255.
    clipped_share : float or None
        Share of the ring's pixels at full scale, 0–1.
    incidence_deg : float, degrees
        Angle between the camera's ray and the feature's normal.
    visibility : str
        "visible", or the reason why the feature was not measured (`Visibility`).
    emulated : bool
        True where the exposure was emulated from another one.
    i_mean, i_mean_p05 … i_mean_p95 : float or None
        Mean and percentiles of the ring's brightness without the pattern, 0–255.
    i_max_p05 … i_max_p95 : float or None
        Percentiles of the pixels' brightest frame, 0–255.
    i_mod_p05 … i_mod_p95 : float or None
        Percentiles of the weakest amplitude of the patterns, grey levels.
    stack_clipped_share : float or None
        Share of the ring's pixels that some frame clips, 0–1.
    low_modulation_share : float or None
        Share of the ring's pixels whose amplitude is below the decoder's limit, 0–1.
    sigma_z_mm : float or None, mm
        Median standard deviation of the ring's points, where the cloud tells it.
    plane_std_mm, form_error_mm : float or None, mm
        Standard deviation of the ring's points about their plane, and the range of the middle 95 %.
    largest_gap_deg : float or None, degrees
        Largest angle round the ring without a point.
    diameter_mm, diameter_error_mm, centre_error_mm : float or None, mm
        A hole's diameter, what it exceeds the nominal one by, and its centre's distance from the
        nominal one in its plane, where the rim is seen (`exposight.observing.ring_geometry`).
    brightness_source : str or None
        What the capture's image is (`exposight.cell.BrightnessSource`).
    sensor, part, finish : str or None
        Names; the finish is that of the surface that the feature is on.
    kind : str or None
        What the feature is: hole, slot, pocket, sphere or surface_point.
    tcp : str or None
        ``camera_from_tcp`` as "x y z w p r" in mm and degrees.
    part_w_deg, part_p_deg, part_r_deg : float or None, degrees
        Orientation of the part in the TCP frame.
    extra : mapping of str to number, text or truth value
        Further columns by name, with their units in their names.
    """

    feature: str
    view: str
    exposure_ms: float
    p_norm: float | None
    i_avg: float | None
    x_mm: float
    y_mm: float
    z_mm: float
    w_deg: float
    p_deg: float
    r_deg: float
    radius_mm: float
    n_points: int | None = None
    n_pixels: int | None = None
    i_std: float | None = None
    i_median: float | None = None
    i_p05: float | None = None
    i_p95: float | None = None
    clipped_share: float | None = None
    incidence_deg: float = math.nan
    visibility: str = Visibility.VISIBLE.value
    emulated: bool = False
    i_mean: float | None = None
    i_mean_p05: float | None = None
    i_mean_p25: float | None = None
    i_mean_p50: float | None = None
    i_mean_p75: float | None = None
    i_mean_p95: float | None = None
    i_max_p05: float | None = None
    i_max_p25: float | None = None
    i_max_p50: float | None = None
    i_max_p75: float | None = None
    i_max_p95: float | None = None
    i_mod_p05: float | None = None
    i_mod_p25: float | None = None
    i_mod_p50: float | None = None
    i_mod_p75: float | None = None
    i_mod_p95: float | None = None
    stack_clipped_share: float | None = None
    low_modulation_share: float | None = None
    sigma_z_mm: float | None = None
    plane_std_mm: float | None = None
    form_error_mm: float | None = None
    largest_gap_deg: float | None = None
    diameter_mm: float | None = None
    diameter_error_mm: float | None = None
    centre_error_mm: float | None = None
    brightness_source: str | None = None
    sensor: str | None = None
    part: str | None = None
    finish: str | None = None
    tcp: str | None = None
    part_w_deg: float | None = None
    part_p_deg: float | None = None
    part_r_deg: float | None = None
    kind: str | None = None
    extra: Mapping[str, float | str | bool | None] = field(default_factory=dict)


_TYPES: dict[str, type[pl.DataType]] = {
    "str": pl.String,
    "str | None": pl.String,
    "float": pl.Float64,
    "float | None": pl.Float64,
    "int | None": pl.Int64,
    "bool": pl.Boolean,
}
SCHEMA = pl.Schema(
    {each.name: _TYPES[str(each.type)] for each in fields(Observation) if each.name != "extra"}
)
"""Names and types of the known columns of an observation table."""

REQUIRED = tuple(SCHEMA)[: tuple(SCHEMA).index("radius_mm") + 1]
"""Columns that every table has; the other known ones may be left out of files."""

_MAY_BE_EMPTY = ("p_norm", "i_avg")
"""Required columns without a value where a feature was not measured."""


@dataclass(frozen=True)
class Range:
    """Which numbers a column may hold, and how documentation and messages say it.

    Parameters
    ----------
    documented : str
        In the table of docs/formats.md.
    low, high : float
        Least and greatest value.
    needs : str
        In messages.
    advice : str
        What to do about a value beyond.
    """

    documented: str
    low: float
    high: float
    needs: str
    advice: str = ""


_GREY = Range("number, 0–255", 0.0, 255.0, "grey levels 0–255")
_SHARE = Range("number, 0–1", 0.0, 1.0, "a share, 0–1, of the ring's pixels")
_PLACE = Range("number, −10⁶ to 10⁶", -1e6, 1e6, "mm within a kilometre of 0")
_ANGLE = Range("number, −360 to 360", -360.0, 360.0, "degrees from −360 to 360")
_SIZE = Range("number, 0 to 10⁶", 0.0, 1e6, "values of at least 0 mm and at most 10⁶")
_COUNT = Range("whole number from 0", 0, 2**53, "whole numbers from 0 on")
RANGES: Mapping[str, Range] = {
    # Above 0; an hour is the longest that sensors' limits may say.
    # Times in ns, up to an hour, are noticed and told by those who use the table.
    "exposure_ms": Range("number above 0", 1e-9, 3.6e12, "values above 0, up to an hour of ns"),
    # A cloud denser than the image gives more than 1; ten points a pixel are percent mistaken.
    "p_norm": Range("number, 0–1", 0.0, 10.0, _SHARE.needs, " (divide percent by 100)"),
    **dict.fromkeys(("x_mm", "y_mm", "z_mm", "diameter_error_mm"), _PLACE),
    "incidence_deg": Range("number, 0–180", 0.0, 180.0, "degrees from 0 to 180"),
    "largest_gap_deg": Range("number, 0–360", 0.0, 360.0, "degrees from 0 to 360"),
    **{n: _ANGLE for n in SCHEMA if n.removeprefix("part_") in {"w_deg", "p_deg", "r_deg"}},
    **{n: _SHARE for n in SCHEMA if n.endswith("_share")},
    **dict.fromkeys(
        ("radius_mm", "sigma_z_mm", "plane_std_mm", "form_error_mm", "diameter_mm",
         "centre_error_mm"), _SIZE),
    **{n: _GREY for n in SCHEMA if n.startswith("i_")},
    **{n: _COUNT for n in SCHEMA if n.startswith("n_")},
}  # fmt: skip
"""What each column of numbers may hold."""

_NAMES = ("feature", "view")
_SAME_CAPTURE = (
    *_NAMES, "exposure_ms", "emulated", "brightness_source", "sensor", "part", "finish", "kind",
    "tcp",
)  # fmt: skip
"""Columns that tell one measurement of a feature from another; further columns do so, too."""


def check_names(names: Sequence[str], required: Sequence[str] = ()) -> None:
    """Check that required columns are there, and no unknown one is a known one misspelt."""
    check_columns_present(names, required)
    absent = [name for name in SCHEMA if name not in names]
    for name in names:
        meant = "" if name in SCHEMA else likely_column(name, absent)
        if meant:
            msg = f"unknown column {name!r}; did you mean {meant!r}?"
            raise FormatError(msg)


def check_columns_present(present: Sequence[str], required: Sequence[str]) -> None:
    """Check that required columns are there; say what may have been meant by others.

    Raises
    ------
    FormatError
        If one is missing.
    """
    missing = [name for name in required if name not in present]
    if not missing:
        return
    if {"name", "kind", "radius_mm"} <= set(present):
        msg = (
            "a list of a part's features, not observations of them; `exposight observe` makes a "
            "table of observations from a campaign"
        )
        raise FormatError(msg)
    unknown = [name for name in present if name not in SCHEMA]
    for name in missing:
        hint = next(filter(None, (unit_hint(column, [name]) for column in unknown)), "")
        if hint:
            msg = f"column {hint}"
            raise FormatError(msg)
        meant = next((column for column in unknown if likely_column(column, [name])), "")
        if meant:
            msg = f"unknown column {meant!r}; did you mean {name!r}?"
            raise FormatError(msg)
    msg = f"missing columns {', '.join(missing)}; found {', '.join(present)}"
    raise FormatError(msg)


def complete(frame: pl.DataFrame) -> pl.DataFrame:
    """Give a frame all columns of `SCHEMA` with their types, then its further ones.

    Raises
    ------
    FormatError
        If a required column is missing, one has the wrong type, or a name is nearly a known one's.
    ObservationError
        If a column of whole numbers has fractions.
    """
    check_names(frame.columns, REQUIRED)
    defaults = {each.name: each.default for each in fields(Observation)}
    left_out = [name for name in SCHEMA if name not in frame.columns]
    filled = frame.with_columns(
        pl.lit(defaults[name], dtype=SCHEMA[name]).alias(name) for name in left_out
    )
    for name, dtype in SCHEMA.items():
        if dtype.is_integer() and filled.schema[name].is_float():  # a cast would cut fractions off
            _refuse(filled[name], filled[name] != filled[name].floor(), "whole numbers")
    further = [name for name in frame.columns if name not in SCHEMA]
    return cast_known(filled, tuple(SCHEMA)).with_columns(filled.select(further))


def cast_known(frame: pl.DataFrame, names: Sequence[str]) -> pl.DataFrame:
    """Give columns the types that they must have; `FormatError` names the first wrong value."""
    for name in names:
        if frame.schema[name] == pl.String and SCHEMA[name].is_numeric():
            unreadable = frame[name].cast(SCHEMA[name], strict=False).is_null()
            wrong = frame[name].is_not_null() & unreadable
            commas = frame[name].filter(wrong).str.contains(",").any()
            expected = f"numbers{' (write a point as decimal separator)' if commas else ''}"
            _refuse(frame[name], wrong, expected, FormatError)
    try:
        return frame.select(pl.col(name).cast(SCHEMA[name]) for name in names)
    except pl.exceptions.PolarsError as error:
        msg = f"a column has values of the wrong type: {str(error).splitlines()[0]}"
        raise FormatError(msg) from error


def check_frame(frame: pl.DataFrame) -> None:
    """Check a table's columns, and that each value that must be there is, and can be."""
    schema = tuple(frame.schema.items())
    if schema[: len(SCHEMA)] != tuple(SCHEMA.items()):
        msg = (
            f"an observation table must have the columns {', '.join(SCHEMA)} with their types, "
            f"got {', '.join(frame.columns)}; ObservationTable.from_frame fills in what "
            "may be left out"
        )
        raise ObservationError(msg)
    for name, dtype in schema[len(SCHEMA) :]:
        check_plain(name, "the column")
        if not (dtype.is_numeric() or dtype in (pl.String, pl.Boolean, pl.Null)):
            msg = f"column {name!r} must hold numbers, texts or truth values, got {dtype}"
            raise ObservationError(msg)
    for name in (*REQUIRED, "visibility", "emulated"):
        if name not in _MAY_BE_EMPTY:
            _refuse(frame[name], frame[name].is_null(), "a value in every row")
    for name, dtype in SCHEMA.items():
        column = frame[name]
        if column.null_count() == len(column):
            continue
        if dtype.is_float() and name != "incidence_deg":  # NaN where the table has none
            _refuse(column, ~column.is_finite(), "finite numbers")
        if name in RANGES:
            allowed = RANGES[name]
            judged = column.fill_nan(None) if name == "incidence_deg" else column
            outside = ~judged.is_between(allowed.low, allowed.high)
            hint = allowed.advice or (_bits_hint(column) if allowed is _GREY else "")
            _refuse(column, outside, f"{allowed.needs}{hint}")
        if dtype == pl.String:
            _refuse(column, has_control_characters(column), "texts without control characters")
    for name in _NAMES:
        _refuse(frame[name], frame[name].str.strip_chars() == "", "a name")
    unlit = frame["p_norm"].is_not_null() & frame["i_avg"].is_null()
    _refuse(frame["i_avg"], unlit, "a value in every row that has a p_norm")
    reasons = [reason.value for reason in Visibility]
    for name, known in (("visibility", reasons), ("brightness_source", get_args(BrightnessSource))):
        unknown = ~frame[name].is_in(known)
        _refuse(frame[name], unknown, f"one of {', '.join(map(repr, known))}")


def check_unrepeated(frame: pl.DataFrame) -> None:
    """Refuse two rows of one feature in one capture that are not the same.

    Rows that are equal in all columns are taken for one that was copied, and said to be
    (`ObservationTable.remarks`).
    """
    if frame.n_unique(["feature", "view", "exposure_ms"]) == len(frame):
        return
    further = [name for name in frame.columns if name not in SCHEMA]
    different = frame.unique(maintain_order=True)
    told_by = [*_SAME_CAPTURE, *further]
    repeated = different.filter(different.select(told_by).is_duplicated())
    if len(repeated):
        feature, view, exposure_ms = repeated.select("feature", "view", "exposure_ms").row(0)
        msg = (
            f"feature {spelled(feature)!r} is there more than once in view {spelled(view)!r} at "
            f"{exposure_ms:g} ms, with different values ({len(repeated)} such rows): keep one, or "
            "tell them apart by the view's name or a further column"
        )
        raise ObservationError(msg)


def _bits_hint(column: pl.Series) -> str:
    """Return what to do about grey values of more than 8 bits."""
    low, high = column.min(), column.max()
    if not (isinstance(low, float) and isinstance(high, float) and low >= 0.0 and high >= 260.0):
        return ""
    bits = next((bits for bits in (10, 12, 16) if high < 2**bits), 0)
    return f" (divide those of {bits} bits by {2 ** (bits - 8)})" if bits else ""


def _refuse(
    column: pl.Series, bad: pl.Series, expected: str, error: type[ExposightError] = ObservationError
) -> None:
    """Refuse a column where `bad` is true; where it is null, there is no value to judge."""
    rows = bad.arg_true()
    if rows.is_empty():
        return
    value = column[rows[0]]
    msg = (
        f"column '{column.name}' needs {expected}; row {rows[0] + 1} after the header "
        f"{'is empty' if value is None else f'has {value!r}'} ({len(rows)} of {len(column)} "
        f"row{'' if len(column) == 1 else 's'} {'is' if len(rows) == 1 else 'are'} wrong)"
    )
    raise error(msg)

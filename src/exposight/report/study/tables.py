"""The paper's tables, ours beside the paper's: Tables 2, 3, 4, 5, 6, 8 and 9."""

from __future__ import annotations

from itertools import groupby
from types import SimpleNamespace as Row
from typing import TYPE_CHECKING

from exposight.quantities import quantity
from exposight.report.markup import (
    Heading,
    count_cell,
    escape,
    exact,
    fixed,
    model_code,
    number,
    table,
    with_unit,
)
from exposight.report.quantities import column_name

if TYPE_CHECKING:
    import polars as pl

    from exposight.paper import StudyResult


_TITLES = {
    2: "Quality models, structured-light sensor",
    3: "Exposure-time models, structured-light sensor",
    4: "Under other lighting: I as trained, II with the cell’s lamp, III with the cell open",
    5: "Both models, active stereo sensor",
    6: "Other finishes, on the door’s outside",
}
_ROLES = {
    "validation": "random split",
    "validation_by_view": "split by view",
    "test": "unseen features",
    "test_inside": "unseen, inside",
    "extended": "",
}
_SQUARED = {"%": "1", "ms": "ms²"}
"""Unit of the MSE, by that of the RMSE: percent is of p_norm's full scale 1."""
_TARGETS = {"%": "quality", "ms": "exposure-time"}
"""What a score is of, by the unit of its RMSE."""
_FULL_SCALE = (
    f" RMSE and MAE of {column_name('p_norm')} are in percent of full scale, its MSE is in squares "
    "of full scale."
)
_RANGES = ("p_norm", "i_avg", "exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
_SHORT_UNITS = {**{name: quantity(name).unit for name in _RANGES}, "i_avg": "0–255"}


def score_tables(result: StudyResult) -> str:
    """Return Tables 2 to 6, as far as the study has them."""
    rows = _rows(result.tables.scores)
    return "".join(
        _score_tables_of(number_, [row for row in rows if row.table == number_])
        for number_ in sorted({row.table for row in rows})
    )


def _rows(frame: pl.DataFrame) -> list[Row]:
    return [Row(**row) for row in frame.iter_rows(named=True)]


def _score_tables_of(number_: int, rows: list[Row]) -> str:
    """Return one of the paper's tables, in two where it has models of both targets."""
    units = list(dict.fromkeys(row.unit for row in rows))
    parts = []
    for unit in units:
        name, title = f"table-{number_}", f"Table {number_}. {_TITLES.get(number_, '')}"
        if len(units) > 1:
            name, title = f"{name}-{_TARGETS[unit]}", f"{title}: {_TARGETS[unit].replace('-', ' ')}"
        own = [row for row in rows if row.unit == unit]
        parts.append(_score_table(own, unit, name=name, title=title))
    return "".join(parts)


def _score_table(rows: list[Row], unit: str, *, name: str, title: str) -> str:
    relative = any(row.relative_error_percent is not None for row in rows)
    shown = []
    before = ""
    for row in rows:
        first = row.variant != before
        before = row.variant
        shown.append(_score_cells(row, first=first, relative=relative))
    caption = (
        f"<b>{title}.</b> Ours, the paper’s, and ours less the "
        "paper’s (Δ). 1σ and 2σ: the share of observations within one and two predicted standard "
        "deviations; 68.3 and 95.4 % is right."
        f"{_FULL_SCALE if unit == '%' else ''}{_by_view_note(rows)}"
    )
    return table(
        _score_headings(unit, relative=relative),
        shown,
        name=name,
        caption=caption,
    )


def _by_view_note(rows: list[Row]) -> str:
    if not any(row.role == "validation_by_view" for row in rows):
        return ""
    return (
        " Split by view: whole views are left out of what the model learns from; its "
        "hyperparameters are those of the random split."
    )


def _score_headings(unit: str, *, relative: bool) -> tuple[Heading, ...]:
    return (
        Heading(text="model, trained on", is_text=True),
        Heading(text="judged by", is_text=True),
        Heading(text="<i>n</i>"),
        *(Heading(text=text, group="R², %") for text in ("ours", "paper", "Δ")),
        *(Heading(text=text, group=f"RMSE, {unit}") for text in ("ours", "paper", "Δ")),
        *(Heading(text=text, group=f"MSE, {_SQUARED[unit]}") for text in ("ours", "paper")),
        Heading(text=f"MAE, {unit}", group="ours only"),
        *([Heading(text="rel. error, %", group="ours only")] if relative else []),
        Heading(text="1σ, %", group="ours only"),
        Heading(text="2σ, %", group="ours only"),
    )


def _score_cells(row: Row, *, first: bool, relative: bool) -> list[str]:
    model = (
        f'{model_code(row.variant)}<span class="under">{escape(row.trained_on)}, '
        f"{count_cell(row.n_train)}</span>"
    )
    return [
        model if first else "",
        _judged_by(row),
        count_cell(row.n),
        exact(row.r2_percent, fixed(row.r2_percent, 1)),
        exact(row.paper_r2_percent, fixed(row.paper_r2_percent, 1)),
        exact(row.r2_difference, fixed(row.r2_difference, 1, signed=True)),
        exact(row.rmse, number(row.rmse)),
        exact(row.paper_rmse, number(row.paper_rmse)),
        exact(row.rmse_difference, fixed(row.rmse_difference, 2, signed=True)),
        exact(row.mse, number(row.mse)),
        exact(row.paper_mse, number(row.paper_mse)),
        exact(row.mae, number(row.mae)),
        *(
            [exact(row.relative_error_percent, fixed(row.relative_error_percent, 1))]
            if relative
            else []
        ),
        exact(row.coverage_1sigma_percent, fixed(row.coverage_1sigma_percent, 1)),
        exact(row.coverage_2sigma_percent, fixed(row.coverage_2sigma_percent, 1)),
    ]


def _judged_by(row: Row) -> str:
    """Return in words what a line is judged by, and beneath the paper's name for it, if any."""
    name = "" if row.role == "validation_by_view" else f"<code>{escape(row.dataset)}</code> "
    words = _ROLES[row.role] or escape(row.dataset)
    name = name if _ROLES[row.role] else ""
    return f'{words}<span class="under">{name}{_features(row.features)}</span>'


def _features(told: str) -> str:
    """Return features such as f1-4_test, with the dash that means to."""
    return escape(told).replace("-", "–")


def hyperparameter_table(result: StudyResult) -> str:
    """Return Table 8, a line for each variant."""
    headings = (
        Heading(text="model", is_text=True),
        Heading(text="fitted here", is_text=True),
        Heading(text="the paper’s", is_text=True),
    )
    rows = []
    for variant, group in groupby(
        _rows(result.tables.hyperparameters), key=lambda row: row.variant
    ):
        own = list(group)
        rows.append(
            [
                model_code(variant),
                " ".join(_hyperparameter(one, one.value, one.at_bound) for one in own),
                " ".join(
                    _hyperparameter(one, one.paper_value, False)
                    for one in own
                    if one.paper_value is not None
                )
                or "–",
            ]
        )
    caption = (
        "<b>Table 8. Hyperparameters.</b> σ² a variance, ℓ a length scale, α the exponent of the "
        "rational quadratic, ε the noise variance; length scales in the paper’s software’s "
        "convention. † ended at a limit of the search: an input that does not matter grows its "
        "length scale as far as allowed."
    )
    return table(headings, rows, name="table-8", caption=caption)


def _hyperparameter(row: Row, value: float | None, at_bound: bool) -> str:
    of = f"({column_name(row.input)})" if row.input else ""
    note = " <b>†</b>" if at_bound else ""
    shown = with_unit(exact(value, number(value)), row.unit)
    return f'<span class="item">{escape(row.symbol)}{of} = {shown}{note}</span>'


def dataset_table(result: StudyResult) -> str:
    """Return Table 9: what was obtained, the paper's beneath."""
    headings = (
        Heading(text="dataset", is_text=True),
        Heading(text="features", is_text=True),
        Heading(text="views"),
        Heading(text="<i>n</i>"),
        Heading(text="train"),
        *(Heading(text=f"{column_name(name)}, {_SHORT_UNITS[name]}") for name in _RANGES),
    )
    rows = [_dataset_cells(row) for row in _rows(result.tables.datasets)]
    caption = (
        "<b>Table 9. What was obtained.</b> Ranges from the least to the greatest value; beneath, "
        "grey, the paper’s. Views in which at least one feature was measured."
    )
    body = table(headings, rows, name="table-9", caption=caption)
    return f'<div class="ranges">{body}</div>\n'


def _dataset_cells(row: Row) -> list[str]:
    return [
        escape(row.dataset),
        f'{_features(row.features)}<span class="under">{row.n_features} seen</span>',
        count_cell(row.n_views),
        _pair(_count(row.n), _count(row.paper_n)),
        _pair(_count(row.n_train), _count(row.paper_n_train)),
        *(_pair(_range(row, own), _range(row, f"paper_{own}")) for own in _RANGES),
    ]


def _pair(ours: str, papers: str) -> str:
    return f'<span>{ours}</span><span class="paper">{papers}</span>'


def _count(value: int | None) -> str:
    return "–" if value is None else count_cell(value)


def _range(row: Row, column: str) -> str:
    ends = [getattr(row, f"{column}_{end}") for end in ("low", "high")]
    if None in ends:
        return "–"
    low, high = (exact(end, f"{end:.3g}".replace("-", "−")) for end in ends)
    return f"{low} … {high}"

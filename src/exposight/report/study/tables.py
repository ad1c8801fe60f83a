"""The paper's tables, ours beside the paper's: Tables 2, 3, 4, 5, 6, 8 and 9."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING

from exposight.report.markup import Heading, count_cell, escape, exact, number, table
from exposight.report.study.words import column_name, rung_code

if TYPE_CHECKING:
    from exposight.paper.result import (
        DatasetRow,
        HyperparameterRow,
        ScoreRow,
        StudyResult,
    )

__all__ = ["dataset_table", "hyperparameter_table", "score_tables"]

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
_RANGES = ("p_norm", "i_avg", "exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
_UNITS = {
    "p_norm": "1",
    "i_avg": "0–255",
    "exposure_ms": "ms",
    "x_mm": "mm",
    "y_mm": "mm",
    "z_mm": "mm",
    "w_deg": "°",
    "p_deg": "°",
}


def score_tables(result: StudyResult) -> str:
    """Return Tables 2 to 6, as far as the study has them."""
    numbers = sorted({row.table for row in result.tables.scores})
    return "".join(
        _score_table(own, [row for row in result.tables.scores if row.table == own])
        for own in numbers
    )


def _score_table(number_: int, rows: list[ScoreRow]) -> str:
    units = {row.unit for row in rows}
    one_unit = units.pop() if len(units) == 1 else ""
    relative = any(row.relative_error_percent is not None for row in rows)
    shown = []
    before = ""
    for row in rows:
        first = row.rung != before
        before = row.rung
        shown.append(_score_cells(row, first=first, with_unit=not one_unit, relative=relative))
    caption = (
        f"<b>Table {number_}. {_TITLES.get(number_, '')}.</b> Ours, the paper’s, and ours less the "
        "paper’s (Δ). 1σ and 2σ: the share of observations within one and two predicted standard "
        "deviations; 68.3 and 95.4 % is right. RMSE and MAE of <i>p</i><sub>norm</sub> in percent "
        f"of full scale.{_by_view_note(rows)}"
    )
    return table(
        _score_headings(one_unit, relative=relative),
        shown,
        name=f"table-{number_}",
        caption=caption,
    )


def _by_view_note(rows: list[ScoreRow]) -> str:
    if not any(row.role == "validation_by_view" for row in rows):
        return ""
    return (
        " Split by view: whole views are left out of what the model learns from; its "
        "hyperparameters are those of the random split."
    )


def _score_headings(unit: str, *, relative: bool) -> tuple[Heading, ...]:
    after = f", {unit}" if unit else ""
    return (
        Heading(text="model, trained on", is_text=True),
        Heading(text="judged by", is_text=True),
        Heading(text="<i>n</i>"),
        *(Heading(text=text, group="R², %") for text in ("ours", "paper", "Δ")),
        *(Heading(text=text, group=f"RMSE{after}") for text in ("ours", "paper", "Δ")),
        *(Heading(text=text, group="MSE") for text in ("ours", "paper")),
        Heading(text=f"MAE{after}", group="ours only"),
        *([Heading(text="rel. error, %", group="ours only")] if relative else []),
        Heading(text="1σ, %", group="ours only"),
        Heading(text="2σ, %", group="ours only"),
    )


def _score_cells(row: ScoreRow, *, first: bool, with_unit: bool, relative: bool) -> list[str]:
    unit = f" {row.unit}" if with_unit else ""
    model = (
        f'{rung_code(row.rung)}<span class="under">{escape(row.trained_on)}, '
        f"{count_cell(row.n_train)}</span>"
    )
    return [
        model if first else "",
        _judged_by(row),
        count_cell(row.n),
        exact(row.r2_percent, _fixed(row.r2_percent, 1)),
        exact(row.paper_r2_percent, _fixed(row.paper_r2_percent, 1)),
        exact(row.r2_difference, _difference(row.r2_difference, 1)),
        _with_unit(row.rmse, unit),
        _with_unit(row.paper_rmse, unit),
        exact(row.rmse_difference, _difference(row.rmse_difference, 2)),
        exact(row.mse, number(row.mse)),
        exact(row.paper_mse, number(row.paper_mse)),
        _with_unit(row.mae, unit),
        *(
            [exact(row.relative_error_percent, _fixed(row.relative_error_percent, 1))]
            if relative
            else []
        ),
        exact(row.coverage_1sigma_percent, _fixed(row.coverage_1sigma_percent, 1)),
        exact(row.coverage_2sigma_percent, _fixed(row.coverage_2sigma_percent, 1)),
    ]


def _with_unit(value: float | None, unit: str) -> str:
    return exact(value, None if value is None else f"{number(value)}{unit}")


def _judged_by(row: ScoreRow) -> str:
    """Return in words what a line is judged by, and beneath the paper's name for it, if any."""
    name = "" if row.role == "validation_by_view" else f"<code>{escape(row.dataset)}</code> "
    words = _ROLES[row.role] or escape(row.dataset)
    name = name if _ROLES[row.role] else ""
    return f'{words}<span class="under">{name}{escape(row.features)}</span>'


def _fixed(value: float | None, digits: int) -> str:
    """Return a number with so many digits behind the point; 0 never has a sign."""
    return "–" if value is None else f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def _difference(value: float | None, digits: int) -> str:
    if value is None:
        return "–"
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def hyperparameter_table(result: StudyResult) -> str:
    """Return Table 8, a line for each rung."""
    headings = (
        Heading(text="model", is_text=True),
        Heading(text="fitted here", is_text=True),
        Heading(text="the paper’s", is_text=True),
    )
    rows = []
    for rung, group in groupby(result.tables.hyperparameters, key=lambda own: own.rung):
        own = list(group)
        rows.append(
            [
                rung_code(rung),
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


def _hyperparameter(row: HyperparameterRow, value: float | None, at_bound: bool) -> str:
    of = f"({column_name(row.input)})" if row.input else ""
    unit = f" {escape(row.unit)}" if row.unit else ""
    note = " <b>†</b>" if at_bound else ""
    shown = exact(value, number(value))
    return f'<span class="item">{escape(row.symbol)}{of} = {shown}{unit}{note}</span>'


def dataset_table(result: StudyResult) -> str:
    """Return Table 9: what was obtained, the paper's beneath."""
    headings = (
        Heading(text="dataset", is_text=True),
        Heading(text="features", is_text=True),
        Heading(text="views"),
        Heading(text="<i>n</i>"),
        Heading(text="train"),
        *(Heading(text=f"{column_name(name)}, {_UNITS[name]}") for name in _RANGES),
    )
    rows = [_dataset_cells(row) for row in result.tables.datasets]
    caption = (
        "<b>Table 9. What was obtained.</b> Ranges from the least to the greatest value; beneath, "
        "grey, the paper’s. Views in which at least one feature was measured."
    )
    body = table(headings, rows, name="table-9", caption=caption)
    return f'<div class="ranges">{body}</div>\n'


def _dataset_cells(row: DatasetRow) -> list[str]:
    return [
        escape(row.dataset),
        f'{escape(row.features)}<span class="under">{row.n_features} seen</span>',
        count_cell(row.n_views),
        _pair(_count(row.n), _count(row.paper_n)),
        _pair(_count(row.n_train), _count(row.paper_n_train)),
        *(
            _pair(_range(getattr(row, own)), _range(getattr(row, f"paper_{own}")))
            for own in _RANGES
        ),
    ]


def _pair(ours: str, papers: str) -> str:
    return f'<span>{ours}</span><span class="paper">{papers}</span>'


def _count(value: int | None) -> str:
    return "–" if value is None else count_cell(value)


def _range(ends: tuple[float, float] | None) -> str:
    if ends is None:
        return "–"
    low, high = (exact(end, f"{end:.3g}".replace("-", "−")) for end in ends)
    return f"{low} … {high}"

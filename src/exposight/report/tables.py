"""The numbers in full: scores of all models, their hyperparameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

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
from exposight.report.selection import model_results

if TYPE_CHECKING:
    from exposight.demo import DemoResult, ModelResult
    from exposight.models import Hyperparameter, ModelSpecification
    from exposight.statistics import RegressionScore


@dataclass(frozen=True, kw_only=True)
class _Target:
    """How scores of a target are shown."""

    title: str
    rmse_unit: str
    rmse_factor: float
    mse_unit: str


_TARGETS = {
    "p_norm": _Target(
        title="Quality models (<i>p</i><sub>norm</sub>)",
        rmse_unit="%",
        rmse_factor=100.0,
        mse_unit="1",
    ),
    "exposure_ms": _Target(
        title="Exposure-time models", rmse_unit="ms", rmse_factor=1.0, mse_unit="ms²"
    ),
}


def score_tables(result: DemoResult) -> str:
    """Return the tables of scores: for each target, unseen features first, then known ones."""
    return "".join(
        _unseen_table(target, style, results) + _known_table(target, style, results)
        for target, style in _TARGETS.items()
        if (results := model_results(result, target))
    )


def hyperparameter_table(result: DemoResult) -> str:
    """Return the table of what every fit found."""
    headings = (
        Heading(text="model"),
        Heading(text="hyperparameters", is_text=True),
        Heading(text="log marginal likelihood"),
        Heading(text="starts"),
        Heading(text="evaluations"),
        Heading(text="converged", is_text=True),
        Heading(text="training, s"),
    )
    rows = [
        [
            model_code(own.model.name),
            _hyperparameters(own),
            exact(own.model.summary.log_marginal_likelihood),
            count_cell(own.model.summary.starts),
            count_cell(own.model.summary.evaluations),
            "yes" if own.model.summary.converged else "no",
            exact(own.seconds, number(own.seconds, 2)),
        ]
        for own in result.results
    ]
    caption = (
        "<b>Hyperparameters.</b> σ² is a kernel’s variance, ℓ a length scale, α the exponent of "
        "the rational quadratic, σ²<sub>n</sub> the noise variance. † ended at the limit that the "
        "optimiser was given, which is to be expected where an input does not matter (its length "
        "scale grows, or its variance shrinks, as far as allowed) and where the function passes "
        "through all observations (the noise variance shrinks)."
    )
    return table(headings, rows, name="hyperparameters", caption=caption)


def _unseen_table(target: str, style: _Target, results: tuple[ModelResult, ...]) -> str:
    headings = (
        Heading(text="model"),
        Heading(text="form", is_text=True),
        Heading(text="inputs", is_text=True),
        Heading(text="<i>n</i> train"),
        *_score_headings(style, "unseen features"),
        Heading(text="<i>n</i>", group="inside the training range"),
        Heading(text="R², %", group="inside the training range"),
        Heading(text=f"RMSE, {style.rmse_unit}", group="inside the training range"),
    )
    rows = []
    for own in results:
        specification, inside = own.model.specification, own.unseen.score_inside
        rows.append(
            [
                model_code(specification.name),
                escape(_form(specification)),
                ", ".join(column_name(name) for name in specification.inputs),
                count_cell(own.model.n_observations),
                *_score_cells(style, own.unseen.score),
                *(_inside_cells(style, inside) if inside else ("0", "–", "–")),
            ]
        )
    caption = (
        f"<b>{style.title} on features they never saw.</b> Named as in the paper; 2σ is the share "
        "of observations within two predicted standard deviations, 95.4 % if these are right."
    )
    return table(headings, rows, name=f"unseen-{target}", caption=caption)


def _known_table(target: str, style: _Target, results: tuple[ModelResult, ...]) -> str:
    headings = (Heading(text="model"), *_score_headings(style, "features that trained"))
    rows = [[model_code(own.model.name), *_score_cells(style, own.known.score)] for own in results]
    caption = (
        f"<b>{style.title} on the observations that trained them.</b> A Gaussian process can pass "
        "through its training data; only unseen features tell how good it is."
    )
    return table(headings, rows, name=f"known-{target}", caption=caption)


def _form(specification: ModelSpecification) -> str:
    """Return a model's title without its target, which the table's caption names."""
    return specification.title.partition(", ")[2] or specification.title


def _score_headings(style: _Target, group: str) -> tuple[Heading, ...]:
    texts = (
        "<i>n</i>", "R², %", f"MSE, {style.mse_unit}", f"RMSE, {style.rmse_unit}",
        f"MAE, {style.rmse_unit}", "2σ, %",
    )  # fmt: skip
    return tuple(Heading(text=text, group=group) for text in texts)


def _score_cells(style: _Target, score: RegressionScore) -> tuple[str, ...]:
    coverage = score.coverage_2sigma
    return (
        count_cell(score.n),
        exact(score.r2_percent, fixed(score.r2_percent, 2)),
        exact(score.mse, number(score.mse)),
        exact(score.rmse, number(style.rmse_factor * score.rmse)),
        exact(score.mae, number(style.rmse_factor * score.mae)),
        exact(coverage, fixed(None if coverage is None else 100 * coverage, 1)),
    )


def _inside_cells(style: _Target, score: RegressionScore) -> tuple[str, ...]:
    return (
        count_cell(score.n),
        exact(score.r2_percent, fixed(score.r2_percent, 2)),
        exact(score.rmse, number(style.rmse_factor * score.rmse)),
    )


def _hyperparameters(result: ModelResult) -> str:
    return " ".join(
        _hyperparameter(
            _symbol(each), each.value, each.unit, " <b>†</b>" if each.remark == "at limit" else ""
        )
        for each in result.model.hyperparameters()
        if each.remark != "fixed"
    )


def _hyperparameter(symbol: str, value: float, unit: str, note: str) -> str:
    return (
        f'<span class="item">{symbol} = {with_unit(exact(value, number(value)), unit)}{note}</span>'
    )


def _symbol(parameter: Hyperparameter) -> str:
    inputs = ", ".join(map(column_name, parameter.inputs))
    match parameter.quantity:
        case "variance":
            return "σ²" if inputs else "σ²<sub>n</sub>"
        case "length_scale":
            return f"ℓ({inputs})"
        case "slope_variance":
            return f"σ²({inputs})"
    return "α"

"""How well models predict observations: errors, bands, chances, as tables."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from exposight.models import P_NORM_MIN, Evaluation
from exposight.tables import Column, Table

_PERCENT: dict[str, Any] = {"digits": 3, "scale": 100.0}

_SCORES = (
    Column(name="model"),
    Column(name="rows"),
    Column(name="n"),
    Column(name="r2_percent", label="R² %", digits=4),
    Column(name="rmse", label="RMSE", digits=3, error_of="target"),
    Column(name="median_relative_error", label="median\nerror %", digits=2, scale=100.0),
    Column(name="coverage_1sigma", label="1σ %", **_PERCENT),
    Column(name="coverage_2sigma", label="2σ %", **_PERCENT),
    Column(name="crps", label="CRPS", digits=2, error_of="target"),
    Column(name="log_score", label="log\nscore", decimals=2),
)

_CHANCES = (
    Column(name="model"),
    Column(name="rows"),
    Column(name="n"),
    Column(name="good", label="came true\n%", **_PERCENT),
    Column(name="said", label="said, mean\n%", **_PERCENT),
    Column(name="brier", label="Brier\nscore", digits=3),
    Column(name="n_edge", label="edge\nrows"),
    Column(name="coverage_edge", label="of these in\n2σ band %", **_PERCENT),
)

_CALIBRATION = (
    Column(name="model"),
    Column(name="bin", label="chance said, %"),
    Column(name="n"),
    Column(name="said", label="mean %", **_PERCENT),
    Column(name="came_true", label="came true %", **_PERCENT),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelScores:
    """How well models predict observations, one evaluation for each; prints as tables."""

    evaluations: tuple[Evaluation, ...]

    @property
    def table(self) -> Table:
        """A row for each model and selection of rows (`Evaluation.selections`)."""
        rows = [
            {
                "model": each.model.name,
                "target": each.model.target,
                "rows": name,
                **asdict(each.score_of(mask)),
                **asdict(each.probability_score(mask)),
            }
            for each in self.evaluations
            for name, mask in each.selections.items()
        ]
        return Table.of("scores", rows, _SCORES)

    @property
    def chances(self) -> Table | None:
        """The chance of a p_norm of at least `P_NORM_MIN`, and rows at the edges of the window.

        Of quality models; None where there is none.
        """
        rows = []
        for each in self.evaluations:
            if each.chance is None:
                continue
            for name, mask in each.selections.items():
                score = each.probability_score(mask)
                rows.append(
                    {
                        "model": each.model.name,
                        "rows": name,
                        "n": int(mask.sum()),
                        "good": float(each.good[mask].mean()),
                        "said": float(each.chance[mask].mean()),
                        "brier": score.brier,
                        "n_edge": score.n_edge,
                        "coverage_edge": score.coverage_edge,
                    }
                )
        title = f"The chance of a p_norm of at least {P_NORM_MIN:g}; edge: 0.03 < p_norm < 0.97"
        return Table.of("chances", rows, _CHANCES, title=title) if rows else None

    @property
    def calibration(self) -> Table | None:
        """Predicted chances and what came of them; None where there is no quality model."""
        rows = [
            {
                "model": each.model.name,
                "bin": f"{100 * group.low:.0f} to {100 * group.high:.0f}",
                **asdict(group),
            }
            for each in self.evaluations
            for group in each.reliability
        ]
        title = "Calibration of that chance, over all rows"
        return Table.of("calibration", rows, _CALIBRATION, title=title) if rows else None

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables that there are."""
        return tuple(
            each for each in (self.table, self.chances, self.calibration) if each is not None
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is odd about the observations, and which features were unseen."""
        remarks = [remark for each in self.evaluations for remark in each.remarks]
        for which, judged in (("no", np.all), ("every", lambda unseen: not unseen.any())):
            names = [
                each.model.name
                for each in self.evaluations
                if each.unseen is not None and judged(each.unseen)
            ]
            if names:
                know = "knows" if len(names) == 1 else "know"
                remarks.append(f"{', '.join(names)} {know} {which} feature of these")
        return tuple(dict.fromkeys(remarks))

    def __str__(self) -> str:
        parts = [str(self.table)]
        parts += [f"\n{each.title}\n{each}" for each in (self.chances,) if each is not None]
        return "\n".join((*parts, *self.remarks))

    def _repr_html_(self) -> str:
        return "".join(
            f"<p>{each.title}</p>{each._repr_html_()}" if each.title else each._repr_html_()
            for each in self.tables
        )

"""What a campaign says about its features, and how well models predict.

Everything is computed here, once; the page only words and draws it.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.errors import ObservationError
from exposight.models import P_NORM_MIN, Evaluation, Predictor, ProbabilityScore, evaluate
from exposight.observing import ObservationTable
from exposight.planning import with_chains


@dataclass(frozen=True, kw_only=True)
class FeatureSummary:
    """How well one feature was measured.

    Parameters
    ----------
    name : str
        The feature.
    radius_mm : float, mm
        Its radius.
    views, observations : int
        In which it was measured.
    p_norm : float
        The best that any of them gave.
    exposure_ms : float, ms
        At which exposure time.
    view : str
        In which view.
    p_norm_at_best : float or None
        Its best p_norm at the campaign's best single exposure time; None where not measured at it.
    """

    name: str
    radius_mm: float
    views: int
    observations: int
    p_norm: float
    exposure_ms: float
    view: str
    p_norm_at_best: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class CampaignSummary:
    """Which features are well measured, and at which exposure times.

    Parameters
    ----------
    features : tuple of FeatureSummary
        The n features that were measured, f10 after f9.
    never_visible : tuple of str
        Features that no view could measure.
    exposures_ms : (m,) ndarray, ms
        Exposure times, ascending.
    p_norm : (n, m) ndarray
        The best that a view gave for each feature at each exposure time; NaN where none did.
    best : int
        Index of the best single exposure time: it brings most features to `P_NORM_MIN`; of several
        the one with the highest mean.
    views, captures, observations : int
        What was measured; captures are those that show a measured feature.
    emulated : bool
        Whether any exposure time was emulated.
    """

    features: tuple[FeatureSummary, ...]
    never_visible: tuple[str, ...]
    exposures_ms: NDArray[np.float64]
    p_norm: NDArray[np.float64]
    best: int
    views: int
    captures: int
    observations: int
    emulated: bool

    @property
    def good(self) -> NDArray[np.int64]:
        """(m,) features with a p_norm of at least `P_NORM_MIN` at each exposure time."""
        return np.asarray((self.p_norm >= P_NORM_MIN).sum(axis=0))

    @property
    def failing(self) -> tuple[FeatureSummary, ...]:
        """Features that stay below `P_NORM_MIN` at every exposure time."""
        return tuple(feature for feature in self.features if feature.p_norm < P_NORM_MIN)


def summarise(table: ObservationTable) -> CampaignSummary:
    """Summarise a table of observations.

    Raises
    ------
    ObservationError
        If no feature was measured.
    """
    frame = table.measured().frame
    if not frame.height:
        counts = ", ".join(f"{number} {reason}" for reason, number in table.counts().items())
        msg = f"a report needs measured observations, got none ({counts or 'no rows'})"
        raise ObservationError(msg)
    by_feature = frame.group_by("feature", maintain_order=True)
    best_rows = by_feature.agg(
        pl.col("radius_mm").first(),
        pl.col("view").n_unique().alias("views"),
        pl.len().alias("observations"),
        pl.col("p_norm").max(),
        pl.col("exposure_ms", "view").get(pl.col("p_norm").arg_max()),
    ).rename({"feature": "name"})
    best_rows = best_rows.sort(pl.col("name").map_elements(_natural, return_dtype=pl.String))
    names = best_rows["name"].to_list()
    exposures_ms = frame["exposure_ms"].unique().sort().to_numpy()
    p_norm = np.full((len(names), len(exposures_ms)), np.nan)
    highest = frame.group_by("feature", "exposure_ms").agg(pl.col("p_norm").max())
    for name, exposure_ms, value in highest.iter_rows():
        p_norm[names.index(name), np.searchsorted(exposures_ms, exposure_ms)] = value
    good = (p_norm >= P_NORM_MIN).sum(axis=0)
    best = max(range(len(exposures_ms)), key=lambda i: (good[i], np.nanmean(p_norm[:, i])))
    return CampaignSummary(
        features=tuple(
            FeatureSummary(**row, p_norm_at_best=None if np.isnan(at_best) else float(at_best))
            for row, at_best in zip(best_rows.iter_rows(named=True), p_norm[:, best], strict=True)
        ),
        never_visible=tuple(
            name for name in dict.fromkeys(table.names("feature")) if name not in names
        ),
        exposures_ms=exposures_ms,
        p_norm=p_norm,
        best=best,
        views=frame["view"].n_unique(),
        captures=frame.select("view", "exposure_ms").n_unique(),
        observations=frame.height,
        emulated=bool(frame["emulated"].any()),
    )


def _natural(name: str) -> str:
    """Return the key that sorts f10 after f9."""
    return re.sub(r"\d+", lambda digits: digits[0].zfill(9), name)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelResult:
    """A trained model and how well it predicts.

    Parameters
    ----------
    model : Predictor
        The model.
    evaluation : Evaluation
        On what the report is of: features that it has not seen, or the table that was given.
    training : Evaluation or None
        On the observations that trained it, where they are at hand.
    """

    model: Predictor
    evaluation: Evaluation
    training: Evaluation | None = None

    @property
    def name(self) -> str:
        """The model's name."""
        return self.model.name

    @cached_property
    def probability(self) -> ProbabilityScore:
        """Scores of its predicted distributions on all rows of `evaluation`."""
        return self.evaluation.probability_score(self.evaluation.selections["all"])


def evaluate_models(
    models: Sequence[Predictor], table: ObservationTable, unseen: Collection[str] = ()
) -> tuple[ModelResult, ...]:
    """Evaluate models on a table.

    Parameters
    ----------
    models : sequence of Predictor
        The models.
    table : ObservationTable
        Observations.
    unseen : collection of str
        Features that the models have not seen: they are evaluated on these, and apart on all
        others, which trained them. Without any they are evaluated on the whole table.

    The paper's models are evaluated one after the other, too (`with_chains`).
    """
    apart = np.isin(table.names("feature"), list(unseen))
    held_out = table.where(apart) if unseen else table
    known = table.where(~apart) if unseen else None
    return tuple(
        ModelResult(
            model=model,
            evaluation=evaluate(model, held_out),
            training=None if known is None else evaluate(model, known),
        )
        for model in with_chains(models)
    )

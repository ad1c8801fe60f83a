"""Scores of predicted quality, and what the paper's chain of two models predicts of the same rows.

Both kinds of prediction are brought into one form: mean, quantiles, band, and the chance that
p_norm reaches 0.75. The chain is `exposight.planning.chained_forecast`: the exposure-time model
says at which time a ring has 80 grey levels, brightness follows in proportion, and the quality
model is averaged over the brightness that this may give. In proportion to what is above the black
level, too, which that forecast does not know: the better of both stands for the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.stats import norm

from benchmarks.models_campaigns import UNSEEN, kept_folder
from exposight.cell import GREY_MAX, ActiveSensor
from exposight.models import GaussianProcessModel, Training, WindowModel, model_named
from exposight.observing import ObservationTable
from exposight.paper.kept_models import table_checksum, train_or_read
from exposight.planning.forecasts import WANTED_BRIGHTNESS
from exposight.twin.sensors import CameraElectronics
from exposight.workers import ignore_progress

Floats = NDArray[np.float64]

NEED: Final = 0.75
"""p_norm that decides (Sect. 3.4.1 of the paper)."""

_LEVELS: Final = (np.arange(41) + 0.5) / 41
BLACK_LEVEL: Final = CameraElectronics().black_level

_POSE: Final = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
_EDGE: Final = (0.03, 0.97)
_NODES, _SUMMING = np.polynomial.hermite_e.hermegauss(15)
_WEIGHTS: Final = _SUMMING / _SUMMING.sum()
_GREY: Final = np.concatenate(
    [np.arange(0.0, 40.0), np.arange(40.0, 100.0, 5.0), np.arange(100.0, 256.0, 2.5)]
)
"""Brightness at which quality is predicted, and linear between: p_norm rises within ten grey levels
and falls within fifty."""

PAPER: Final = ("q_k1", "q_k4", "e_k6")


@dataclass(frozen=True, kw_only=True, eq=False)
class Guess:
    """What is predicted of the quality of n rows.

    Parameters
    ----------
    mean, low, high : (n,) ndarray
        Mean, and the band of two standard deviations or of its quantiles, within 0 to 1.
    quantiles : (41, n) ndarray
        At equally likely levels.
    chance : (n,) ndarray
        Of p_norm ≥ `NEED`.
    """

    mean: Floats
    low: Floats
    high: Floats
    quantiles: Floats
    chance: Floats

    def where(self, mask: NDArray[np.bool_]) -> Guess:
        """Return the rows where `mask` is true."""
        return Guess(
            mean=self.mean[mask],
            low=self.low[mask],
            high=self.high[mask],
            quantiles=self.quantiles[:, mask],
            chance=self.chance[mask],
        )


@dataclass(frozen=True, kw_only=True)
class QualityScore:
    """Scores of a `Guess`; RMSE in % of full scale."""

    rmse_percent: float
    crps: float
    band_width: float
    coverage: float
    coverage_edge: float
    brier: float


def model_guess(model: WindowModel, rows: ObservationTable) -> Guess:
    """Return what a model predicts of rows from pose and exposure time."""
    prediction = model.predict(rows)
    return Guess(
        mean=prediction.mean,
        low=np.clip(prediction.low, 0.0, 1.0),
        high=np.clip(prediction.high, 0.0, 1.0),
        quantiles=model.quantiles(rows.frame, _LEVELS.tolist()),
        chance=model.chance(rows.frame, need=NEED),
    )


def normal_guess(mean: Floats, std: Floats) -> Guess:
    """Return normal distributions as a guess, their band within what p_norm can be."""
    std = np.maximum(std, 1e-9)
    return Guess(
        mean=mean,
        low=np.clip(mean - 2 * std, 0.0, 1.0),
        high=np.clip(mean + 2 * std, 0.0, 1.0),
        quantiles=mean + std * norm.ppf(_LEVELS)[:, None],
        chance=norm.sf((NEED - mean) / std),
    )


def score(rows: ObservationTable, guess: Guess) -> QualityScore:
    """Score predictions of measured rows."""
    observed = p_norm(rows)
    covered = (observed >= guess.low - 1e-9) & (observed <= guess.high + 1e-9)
    edge = (observed > _EDGE[0]) & (observed < _EDGE[1])
    return QualityScore(
        rmse_percent=100.0 * rms(guess.mean - observed),
        crps=float(crps(observed, guess.quantiles).mean()),
        band_width=float((guess.high - guess.low).mean()),
        coverage=float(covered.mean()),
        coverage_edge=float(covered[edge].mean()),
        brier=float(((guess.chance - (observed >= NEED)) ** 2).mean()),
    )


def crps(observed: Floats, quantiles: Floats) -> Floats:
    """Return the continuous ranked probability score, as twice the mean pinball loss, (n,)."""
    over = observed - quantiles
    pinball = np.where(over >= 0, _LEVELS[:, None] * over, (_LEVELS[:, None] - 1.0) * over)
    return np.asarray(2.0 * pinball.mean(axis=0))


def one_exposure_per_view(rows: ObservationTable, chance: Floats) -> tuple[int, int]:
    """Count rings that one exposure time per view brings to `NEED`.

    Returns
    -------
    int
        At the time of the highest summed chance in each view.
    int
        At the best time of each view.
    """
    times = (
        rows.frame.select("view", "exposure_ms", good=pl.col("p_norm") >= NEED)
        .with_columns(pl.Series("chance", chance))
        .group_by("view", "exposure_ms", maintain_order=True)
        .agg(pl.col("good").sum(), pl.col("chance").sum())
    )
    views = times.group_by("view").agg(
        chosen=pl.col("good").sort_by("chance").last(), best=pl.col("good").max()
    )
    return int(views["chosen"].sum()), int(views["best"].sum())


def p_norm(rows: ObservationTable) -> Floats:
    """Return the measured quality of rows, within 0 to 1."""
    return np.asarray(np.clip(rows.array(["p_norm"])[:, 0], 0.0, 1.0))


def rms(values: Floats) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def unseen(rows: ObservationTable) -> NDArray[np.bool_]:
    """Return which rows are of features that trained nothing."""
    return np.isin(rows.names("feature").astype(str), UNSEEN)


# -- the paper's chain ------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperModels:
    """The paper's models q_k1, q_k4 and e_k6 of one table."""

    models: dict[str, GaussianProcessModel]

    def chains(self, rows: ObservationTable) -> dict[str, Guess]:
        """Return what e_k6 and each quality model make of rows, from pose and exposure time.

        With brightness in proportion to time, and with that above the black level.
        """
        keys = rows.frame.select("view", "feature")
        rings = rows.frame.unique(["view", "feature"], maintain_order=True)
        places = rings.select("view", "feature").with_row_index("ring")
        ring = keys.join(places, on=["view", "feature"], how="left", maintain_order="left")
        of_row = ring["ring"].to_numpy().astype(np.int64)
        wanted = self.models["e_k6"].predict(rings.with_columns(i_avg=pl.lit(WANTED_BRIGHTNESS)))
        exposure_ms = rows.array(["exposure_ms"])
        nodes_ms = wanted.mean[of_row, None] + wanted.std[of_row, None] * _NODES
        nodes_ms = np.maximum(nodes_ms, exposure_ms.min() / 10.0)
        guesses = {}
        for quality in ("q_k1", "q_k4"):
            tables = self._by_brightness(quality, rings)
            for black in (0.0, BLACK_LEVEL):
                brightness = black + (WANTED_BRIGHTNESS - black) * exposure_ms / nodes_ms
                mean, std = (
                    _interpolated(table, of_row, np.minimum(brightness, GREY_MAX))
                    for table in tables
                )
                average = mean @ _WEIGHTS
                variance = (std**2 + mean**2) @ _WEIGHTS - average**2
                guesses[f"{quality}, black level {black:g}"] = normal_guess(
                    average, np.sqrt(np.maximum(variance, 0.0))
                )
        return guesses

    def _by_brightness(self, quality: str, rings: pl.DataFrame) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of quality at the brightness `_GREY`, by ring."""
        model = self.models[quality]
        shape = (rings.height, len(_GREY))
        repeated = rings[np.repeat(np.arange(shape[0]), shape[1])].with_columns(
            pl.Series("i_avg", np.tile(_GREY, shape[0]))
        )
        inputs = repeated.select(model.inputs)
        unique = inputs.unique(maintain_order=True)
        predicted = model.predict(unique)
        values = unique.with_columns(
            pl.Series("mean", predicted.mean), pl.Series("std", predicted.std)
        )
        found = inputs.join(values, on=list(model.inputs), how="left", maintain_order="left")
        mean, std = (found[name].to_numpy().reshape(shape) for name in ("mean", "std"))
        return mean, std

    def best(self, rows: ObservationTable) -> QualityScore:
        """Return the scores of the chain with the least error."""
        scores = [score(rows, guess) for guess in self.chains(rows).values()]
        return min(scores, key=lambda each: each.rmse_percent)

    def exposure_ms(self, rows: ObservationTable) -> Floats:
        """Return e_k6's exposure times for the brightness that rows have."""
        return self.models["e_k6"].predict(rows).mean


def _interpolated(table: Floats, ring: NDArray[np.int64], brightness: Floats) -> Floats:
    """Return a table's values, (rings, `_GREY`), for rows of a ring each, at (n, k) brightness."""
    cell = np.clip(np.searchsorted(_GREY, brightness, side="right") - 1, 0, len(_GREY) - 2)
    share = (brightness - _GREY[cell]) / (_GREY[cell + 1] - _GREY[cell])
    below, above = table[ring[:, None], cell], table[ring[:, None], cell + 1]
    return np.asarray(below + share * (above - below))


def paper_models(table: ObservationTable, sensor: ActiveSensor) -> PaperModels:
    """Return the paper's models of a table, trained where they are not kept."""
    trained = keep_paper_models([(table, sensor)], workers=1)
    return PaperModels(models=dict(zip(PAPER, trained, strict=True)))


def keep_paper_models(
    campaigns: Sequence[tuple[ObservationTable, ActiveSensor]], *, workers: int
) -> tuple[GaussianProcessModel, ...]:
    """Train the paper's models of several tables where they are not kept, and return them."""
    trainings = [
        Training(
            specification=model_named(name),
            table=table,
            seed=1,
            source_sha256=table_checksum(table),
            sensor=sensor,
            restarts=1,
            committee_rows=None,
        )
        for table, sensor in campaigns
        for name in PAPER
    ]
    return train_or_read(trainings, kept_folder(), workers=workers, progress=ignore_progress)


# -- what the sections of the benchmark hand over ---------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One figure, for one seed.

    Parameters
    ----------
    value : float
    coverage : float or None
        Share of the rows within the band of two standard deviations.
    paper : float or None
        The same figure of the paper's chain on the same rows.
    """

    value: float
    coverage: float | None = None
    paper: float | None = None


Figures = dict[str, Measured]


def quality_figure(
    model: WindowModel, rows: ObservationTable, paper: PaperModels | None = None
) -> Measured:
    """Return the error of predicted quality in percent, from pose and exposure time."""
    result = score(rows, model_guess(model, rows))
    return Measured(
        value=result.rmse_percent,
        coverage=result.coverage,
        paper=None if paper is None else paper.best(rows).rmse_percent,
    )


def exposure_figures(
    model: WindowModel, rows: ObservationTable, paper: PaperModels | None = None
) -> tuple[Measured, Measured]:
    """Return errors of the exposure time for the brightness that good rows have.

    Returns
    -------
    Measured, ms
        Root mean square.
    Measured
        Median relative.
    """
    good = rows.with_quality(NEED)
    exposure_ms = good.array(["exposure_ms"])[:, 0]
    predicted = model.radiance.predict(good)
    inside = (exposure_ms >= predicted.low) & (exposure_ms <= predicted.high)
    errors = [predicted.mean - exposure_ms]
    if paper is not None:
        errors.append(paper.exposure_ms(good) - exposure_ms)
    squared = [*map(rms, errors), None][:2]
    relative = [*(float(np.median(np.abs(each) / exposure_ms)) for each in errors), None][:2]
    coverage = float(inside.mean())
    return (
        Measured(value=squared[0], coverage=coverage, paper=squared[1]),  # type: ignore[arg-type]
        Measured(value=relative[0], coverage=coverage, paper=relative[1]),  # type: ignore[arg-type]
    )

"""What a campaign says about its features, one view of it in full, and how well models predict.

Everything is computed here, once; the page only words and draws it.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Capture, CaptureSource
from exposight.errors import ObservationError
from exposight.geometry import RigidTransform
from exposight.models import P_NORM_MIN, Evaluation, Predictor, evaluate
from exposight.observing import FeatureView, ObservationTable, view_features
from exposight.planning import DEFAULT_MODELS, Forecast, SensorModels
from exposight.statistics import RegressionScore, score


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
        for model in models
    )


BRACKET = 4.0
"""How much shorter and longer than the shown one the other two exposure times are."""
QUALITY_MODEL, EXPOSURE_MODEL = DEFAULT_MODELS
"""The paper's best models of each kind (Tables 2 and 3): the demonstration forecasts with them, and
their predictions are shown first."""
_POSE = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewForecast:
    """What two models expect of a view, from its pose alone, and how right they were.

    Parameters
    ----------
    quality, exposure : str
        Names of the models.
    choice : Forecast
        Over all exposure times that were weighed.
    taken : Forecast
        At the exposure times of the shown captures.
    score : RegressionScore
        Of the forecast p_norm at them.
    """

    quality: str
    exposure: str
    choice: Forecast
    taken: Forecast
    score: RegressionScore


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownView:
    """A view in full: n features at m exposure times.

    Parameters
    ----------
    name : str
        The view.
    features : tuple of str
        The n features that it measures.
    radii_mm : (n,) ndarray, mm
        Their radii.
    tcp_from_feature : tuple of RigidTransform
        Where they stand.
    exposures_ms : tuple of float, ms
        The m exposure times, ascending.
    main : int
        Index of the one to look at first.
    i_avg, p_norm : (n, m) ndarray
        What was measured; NaN where nothing was.
    captures : tuple of Capture
        The m captures; none where there are no images.
    views : tuple of FeatureView
        The features' masks; none where there are no images.
    sensor : ActiveSensor or None
        That took the captures.
    forecast : ViewForecast or None
        What models expect of the view.
    """

    name: str
    features: tuple[str, ...]
    radii_mm: NDArray[np.float64]
    tcp_from_feature: tuple[RigidTransform, ...]
    exposures_ms: tuple[float, ...]
    main: int
    i_avg: NDArray[np.float64]
    p_norm: NDArray[np.float64]
    captures: tuple[Capture, ...] = ()
    views: tuple[FeatureView, ...] = ()
    sensor: ActiveSensor | None = None
    forecast: ViewForecast | None = None

    @property
    def good(self) -> tuple[int, ...]:
        """Number of features with a p_norm of at least `P_NORM_MIN` at each exposure time."""
        return tuple((self.p_norm >= P_NORM_MIN).sum(axis=0).tolist())


def _fullest_view(measured: ObservationTable) -> str:
    """Return the view that measures most features; of several the one with most observations."""
    counts = measured.frame.group_by("view", maintain_order=True).agg(
        pl.col("feature").n_unique().alias("features"), pl.len().alias("rows")
    )
    return str(counts.sort("features", "rows", descending=True, maintain_order=True)["view"][0])


def show_view(
    table: ObservationTable,
    *,
    main_ms: float | None = None,
    campaign: CaptureSource | None = None,
) -> ShownView:
    """Pick the view that measures most features, and three of its exposure times.

    Parameters
    ----------
    table : ObservationTable
        What was observed.
    main_ms : float, optional, ms
        The exposure time to look at first; the one with the highest mean p_norm by default. The
        others are a shorter and a longer one.
    campaign : CaptureSource, optional
        Brings the view's captures.
    """
    rows = table.measured()
    name = _fullest_view(rows)
    rows = rows.where(rows.names("view") == name)
    features = tuple(dict.fromkeys(rows.names("feature")))
    times = np.unique(rows.array(["exposure_ms"]))
    i_avg, p_norm = np.full((2, len(features), len(times)), np.nan)
    for feature, *values in rows.frame.select("feature", "exposure_ms", "i_avg", "p_norm").rows():
        place = features.index(feature), np.searchsorted(times, values[0])
        i_avg[place], p_norm[place] = values[1:]
    if main_ms is None:
        main_ms = float(times[np.nanmean(p_norm, axis=0).argmax()])
    shown = sorted({_nearest(times, main_ms * factor) for factor in (1 / BRACKET, 1.0, BRACKET)})
    first = rows.frame.unique("feature", keep="first", maintain_order=True)
    view = ShownView(
        name=name,
        features=features,
        radii_mm=first["radius_mm"].to_numpy(),
        tcp_from_feature=tuple(
            RigidTransform.from_fanuc_wpr(pose[:3], *pose[3:])
            for pose in first.select(*_POSE).iter_rows()
        ),
        exposures_ms=tuple(times[shown].tolist()),
        main=shown.index(_nearest(times, main_ms)),
        i_avg=i_avg[:, shown],
        p_norm=p_norm[:, shown],
    )
    return view if campaign is None else _with_captures(view, campaign)


def _nearest(times: NDArray[np.float64], wanted_ms: float) -> int:
    return int(np.abs(np.log(times / wanted_ms)).argmin())


def _with_captures(view: ShownView, campaign: CaptureSource) -> ShownView:
    captures = [
        capture
        for capture in campaign.captures()
        if capture.view == view.name and capture.exposure_ms in view.exposures_ms
    ]
    if not captures:
        return view
    masks = view_features(campaign.part, campaign.sensor, captures[0].camera_from_part)
    by_name = {mask.feature.name: mask for mask in masks}
    return replace(
        view,
        captures=tuple(sorted(captures, key=lambda capture: capture.exposure_ms)),
        views=tuple(by_name[name] for name in view.features),
        sensor=campaign.sensor,
    )


def forecasting_models(models: Sequence[Predictor]) -> SensorModels | None:
    """Pick a quality and an exposure-time model that can forecast a view from its pose.

    The default ones are preferred (`DEFAULT_MODELS`), then those with most inputs; None if there
    are not both.
    """
    chosen = []
    able_models = [model for model in models if set(model.inputs) <= {"i_avg", *_POSE}]
    for target, preferred in zip(("p_norm", "exposure_ms"), DEFAULT_MODELS, strict=True):
        able = [model for model in able_models if model.target == target]
        if not able:
            return None
        chosen.append(max(able, key=lambda model: (model.name == preferred, len(model.inputs))))
    return SensorModels(quality=chosen[0], exposure=chosen[1])


def with_forecast(
    view: ShownView, models: SensorModels, taken_before: tuple[Forecast, Forecast] | None = None
) -> ShownView:
    """Forecast a view, and compare with what it measured; a view without captures stays as it is.

    Parameters
    ----------
    view : ShownView
        Where its features stand is known from its captures.
    models : SensorModels
        Forecast it.
    taken_before : (Forecast, Forecast), optional
        Forecasts that were made before the view was taken, over all exposure times and at those of
        the view; made now by default.
    """
    if not view.views:
        return view
    choice, taken = taken_before or (
        models.forecast(view.views),
        models.forecast(view.views, view.exposures_ms),
    )
    measured = np.isfinite(view.p_norm)
    return replace(
        view,
        forecast=ViewForecast(
            quality=models.quality.name,
            exposure=models.exposure.name,
            choice=choice,
            taken=taken,
            score=score(view.p_norm[measured], taken.p_norm[measured], taken.p_norm_std[measured]),
        ),
    )

"""One view of a campaign in full: what it measured, and what models expect of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import ActiveSensor, Capture, CaptureSource
from exposight.geometry import RigidTransform
from exposight.models import P_NORM_MIN, Predictor, RadianceModel, WindowModel
from exposight.observing import FeatureView, ObservationTable, View
from exposight.planning import Forecast, SensorModels
from exposight.statistics import RegressionScore, score

BRACKET = 4.0
"""How much shorter and longer than the shown one the other two exposure times are."""
_POSE = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewForecast:
    """What a pair of models expects of a view, from its pose alone, and how right it was.

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
    width : float
        Mean width of its 2σ bands.
    """

    quality: str
    exposure: str
    choice: Forecast
    taken: Forecast
    score: RegressionScore
    width: float


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
    pose : View or None
        How the view sees its features; None where there are no images.
    sensor : ActiveSensor or None
        That took the captures.
    forecasts : tuple of ViewForecast
        What models expect of the view, those to follow first; none where there are none.
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
    pose: View | None = None
    sensor: ActiveSensor | None = None
    forecasts: tuple[ViewForecast, ...] = ()

    @property
    def forecast(self) -> ViewForecast | None:
        """The forecast to follow."""
        return self.forecasts[0] if self.forecasts else None

    @property
    def views(self) -> tuple[FeatureView, ...]:
        """The features' masks; none where there are no images."""
        return () if self.pose is None else self.pose.features

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
    times_ms: Sequence[float] = (),
    campaign: CaptureSource | None = None,
) -> ShownView:
    """Pick the view that measures most features, and up to three of its exposure times.

    Parameters
    ----------
    table : ObservationTable
        What was observed.
    times_ms : sequence of float, ms
        The exposure times to show; by default that with the highest mean p_norm, a shorter and a
        longer one.
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
    main = int(np.nanmean(p_norm, axis=0).argmax())
    wanted = times_ms or [float(times[main]) * factor for factor in (1 / BRACKET, 1.0, BRACKET)]
    shown = sorted({_nearest(times, each) for each in wanted})
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
        main=shown.index(main) if main in shown else len(shown) // 2,
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
    pose = captures[0].camera_from_part
    whole = View.of(campaign.part, campaign.sensor, pose, name=view.name)
    by_name = {mask.feature.name: mask for mask in whole.features}
    return replace(
        view,
        captures=tuple(sorted(captures, key=lambda capture: capture.exposure_ms)),
        pose=replace(whole, features=tuple(by_name[name] for name in view.features)),
        sensor=campaign.sensor,
    )


_PAPER_PAIR = ("q_k4", "e_k6")
"""The paper's best models of each kind (Tables 2 and 3): preferred to its others."""


def forecasting_models(models: Sequence[Predictor]) -> tuple[SensorModels, ...]:
    """Pick the pairs of models that can forecast a view from its pose, the default one first.

    Then, of all others, the quality and the exposure-time model with most inputs. None, one or two
    pairs.
    """
    pairs = [SensorModels(quality=each) for each in models if isinstance(each, WindowModel)][:1]
    chosen = []
    able_models = [model for model in models if set(model.inputs) <= {"i_avg", *_POSE}]
    for target, preferred in zip(("p_norm", "exposure_ms"), _PAPER_PAIR, strict=True):
        able = [
            model
            for model in able_models
            if model.target == target and not isinstance(model, RadianceModel)
        ]
        if not able:
            return tuple(pairs)
        chosen.append(max(able, key=lambda model: (model.name == preferred, len(model.inputs))))
    return (*pairs, SensorModels(quality=chosen[0], exposure=chosen[1]))


def with_forecasts(
    view: ShownView,
    models: Sequence[SensorModels],
    made_before: Sequence[tuple[Forecast, Forecast]] = (),
) -> ShownView:
    """Forecast a view, and compare with what it measured; a view without captures stays as it is.

    Parameters
    ----------
    view : ShownView
        Where its features stand is known from its captures.
    models : sequence of SensorModels
        Forecast it; the first pair's forecast is the one to follow.
    made_before : sequence of (Forecast, Forecast), optional
        Forecasts that were made before the view was taken, one for each pair: over all exposure
        times and at those of the view; made now by default.
    """
    if view.pose is None:
        return view
    measured = np.isfinite(view.p_norm)
    forecasts: list[ViewForecast] = []
    for place, pair in enumerate(models):
        if made_before:
            choice, taken = made_before[place]
        else:
            times_ms = forecasts[0].choice.exposures_ms if forecasts else None
            choice = pair.forecast(view.pose, times_ms)
            taken = pair.forecast(view.pose, view.exposures_ms)
        low, high = taken.p_norm_low[measured], taken.p_norm_high[measured]
        forecasts.append(
            ViewForecast(
                quality=pair.quality.name,
                exposure=pair.exposure.name,
                choice=choice,
                taken=taken,
                score=score(view.p_norm[measured], taken.p_norm[measured], band=(low, high)),
                width=float(np.mean(high - low)),
            )
        )
    return replace(view, forecasts=tuple(forecasts))

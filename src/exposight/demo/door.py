"""The whole method on the simulated cell: a door is measured, learnt, and met in a new view.

Some features train in views over three depth planes, others are never shown to the models. Then
the sensor stands where it never stood: the exposure time is chosen by prediction alone, the view
is taken, and what came is held against what was predicted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import Capture, write_features
from exposight.demo.door_picture import DoorMesh, door_mesh, field_of_view_mm
from exposight.demo.result import DemoResult, DemoSettings
from exposight.demo.training import Lesson, Progress, make_folder, silent, train_models
from exposight.errors import InputError
from exposight.models import ModelSpecification, model_named
from exposight.observing import FeatureView, Visibility, observe_campaign, view_features
from exposight.planning import Forecast, forecast
from exposight.plans import PLANS, DepthPlane, MeasuringPlan, logarithmic_exposures, views
from exposight.statistics import RegressionScore, score
from exposight.twin.campaign import CellSettings, scene_at, simulate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.cell import ActiveSensor, CampaignFolder
    from exposight.demo.result import ModelResult
    from exposight.observing import ObservationTable

QUALITY_MODEL, EXPOSURE_MODEL = "q_k4", "e_k6"
"""The paper's best models of each kind (Tables 2 and 3); they forecast the new view."""

_MODELS = tuple(map(model_named, ("q_k1", QUALITY_MODEL, "e_k1", "e_k4", EXPOSURE_MODEL)))
_UNSEEN_SUFFIX = "_test"  # as the door's test features are called
_CHOICES = 61
_BRACKET = 4.0
"""How much shorter and longer than the chosen one the other two exposure times are."""

_NEW_POSITION = DepthPlane(
    name="new",
    # Between the campaign's depth planes, and off the grid of each in x and y.
    z_tcp_mm=70.0,
    x_mm=(40.0,),
    y_mm=(0.0,),
    exposures_ms=(1.0,),  # until they are chosen
)


@dataclass(frozen=True, kw_only=True)
class DoorSettings(DemoSettings):
    """What the demonstration on the simulated cell does.

    Parameters
    ----------
    models : tuple of ModelSpecification
        Which ones are trained; `QUALITY_MODEL` and `EXPOSURE_MODEL` among them.
    plan : MeasuringPlan
        The campaign. Its features whose names end in ``_test`` do not train.

    Raises
    ------
    InputError
        If one of the two models is missing, no feature is left to train or to judge by, or as for
        `DemoSettings`.
    """

    models: tuple[ModelSpecification, ...] = _MODELS
    plan: MeasuringPlan = PLANS["demo"]

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [model.name for model in self.models]
        missing = [name for name in (QUALITY_MODEL, EXPOSURE_MODEL) if name not in names]
        if missing:
            msg = (
                f"the demonstration on the door needs the models {QUALITY_MODEL} and "
                f"{EXPOSURE_MODEL}, got {', '.join(names)}; add {' and '.join(missing)}"
            )
            raise InputError(msg)
        unseen = {name for name in self.plan.features if name.endswith(_UNSEEN_SUFFIX)}
        if not 0 < len(unseen) < len(self.plan.features):
            msg = (
                f"plan {self.plan.name!r}: the demonstration needs features that train and "
                f"features whose names end in {_UNSEEN_SUFFIX!r}, got "
                f"{', '.join(self.plan.features)}"
            )
            raise InputError(msg)


@dataclass(frozen=True, kw_only=True, eq=False)
class NewView:
    """A view that was not in the campaign: forecast first, then taken.

    Parameters
    ----------
    position_mm : (float, float, float), mm
        Where the plan's reference feature was to lie in the TCP frame.
    views : tuple of FeatureView
        The features that it sees.
    choice : Forecast
        Over all exposure times that were weighed.
    chosen_ms : float, ms
        The one with the best forecast.
    taken : Forecast
        At the exposure times that were taken: shorter, chosen, longer.
    captures : tuple of Capture
        The same, as they came: whole frames.
    i_avg, p_norm : (features, 3) ndarray
        What was measured in them.
    score : RegressionScore
        Of the forecast p_norm, over all features and the three exposure times.
    field_of_view_mm : (n, 3) ndarray, mm
        The border of the image on the door, in the part's frame.
    """

    position_mm: tuple[float, float, float]
    views: tuple[FeatureView, ...]
    choice: Forecast
    chosen_ms: float
    taken: Forecast
    captures: tuple[Capture, ...]
    i_avg: NDArray[np.float64]
    p_norm: NDArray[np.float64]
    score: RegressionScore
    field_of_view_mm: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class DoorResult(DemoResult):
    """Everything the demonstration on the simulated cell found.

    Parameters
    ----------
    settings : DoorSettings
        What was asked for.
    n_views, n_captures : int
        Of the campaign.
    new_view : NewView
        The view that was not in it.
    mesh : DoorMesh
        The door, coarse, to be drawn.
    """

    settings: DoorSettings
    n_views: int
    n_captures: int
    new_view: NewView
    mesh: DoorMesh


def run_door(
    output: str | Path,
    settings: DoorSettings | None = None,
    progress: Progress | None = None,
) -> DoorResult:
    """Run the whole method on the simulated cell.

    Whatever was captured stays in ``output/campaign`` and ``output/new-view``; run again, only
    what is missing is made.

    Parameters
    ----------
    output : path
        Folder for campaign, observations and models; made if it is not there.
    settings : DoorSettings, optional
        What to do.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        If the folder holds a demonstration of other settings.
    """
    settings = settings or DoorSettings()
    tell = progress or silent
    folder = make_folder(Path(output))
    tell("building the door", 0, 1)
    part = settings.plan.observed_part(scene_at(None).part)
    tell("building the door", 1, 1)
    plan = replace(settings.plan, seed=settings.seed)
    rings = CellSettings(rings_only=True, workers=settings.workers)
    campaign = _simulate(plan, folder / "campaign", rings, "measuring the door", tell)
    write_features(folder / "features.csv", part.features)
    table = observe_campaign(campaign, progress=tell)
    table.write(folder / "observations.csv")
    names = table.names("feature")
    unseen = np.array([name.endswith(_UNSEEN_SUFFIX) for name in names])
    lesson = Lesson(
        known=table.where(~unseen),
        unseen=table.where(unseen),
        sensor=campaign.sensor,
        source=f"plan {plan.name!r} on the simulated cell",
    )
    results = train_models(folder / "models", lesson, settings, tell)
    mesh = door_mesh()
    return DoorResult(
        settings=settings,
        output=folder,
        sensor=campaign.sensor,
        table=table,
        train_features=frozenset(names[~unseen].tolist()),
        results=results,
        n_views=len(set(table.names("view"))),
        n_captures=len(campaign),
        new_view=_new_view(plan, folder / "new-view", campaign, results, mesh, tell),
        mesh=mesh,
    )


def _simulate(
    plan: MeasuringPlan, folder: Path, settings: CellSettings, stage: str, tell: Progress
) -> CampaignFolder:
    try:
        return simulate(plan, folder, settings, lambda done, n: tell(stage, done, n))
    except InputError as error:
        msg = f"{error} (it may hold another demonstration, or one of another seed)"
        raise InputError(msg) from error


def _new_view(
    plan: MeasuringPlan,
    folder: Path,
    campaign: CampaignFolder,
    results: tuple[ModelResult, ...],
    mesh: DoorMesh,
    tell: Progress,
) -> NewView:
    """Forecast the view at all exposure times, choose one, and only then take the view."""
    sensor, part = campaign.sensor, campaign.part
    models = {own.model.name: own.model for own in results}
    quality, exposure = models[QUALITY_MODEL], models[EXPOSURE_MODEL]
    tell("forecasting a new view", 0, 1)
    plan = replace(plan, name="new view", planes=(_NEW_POSITION,), random=())
    (planned,) = views(plan, part, sensor)
    seen = _visible(view_features(part, sensor, planned.reported_camera_from_part))
    weighed = logarithmic_exposures(*exposure.target_range, _CHOICES, sensor)
    choice = forecast(quality, exposure, seen, sorted(set(weighed)))  # rounding doubles some
    chosen_ms = choice.best_exposure_ms()
    exposures_ms = _bracket(chosen_ms, sensor)
    foretold = forecast(quality, exposure, seen, exposures_ms)
    tell("forecasting a new view", 1, 1)
    plan = replace(plan, planes=(replace(_NEW_POSITION, exposures_ms=exposures_ms),))
    taken = _simulate(plan, folder, CellSettings(), "taking the new view", tell)
    i_avg, p_norm = _measured(observe_campaign(taken), foretold)
    return NewView(
        position_mm=next(where for _, where in _NEW_POSITION.positions()),
        views=seen,
        choice=choice,
        chosen_ms=chosen_ms,
        taken=foretold,
        captures=tuple(sorted(taken.captures(), key=lambda capture: capture.exposure_ms)),
        i_avg=i_avg,
        p_norm=p_norm,
        score=score(p_norm.ravel(), foretold.p_norm.ravel(), foretold.p_norm_std.ravel()),
        field_of_view_mm=field_of_view_mm(sensor.camera, planned.reported_camera_from_part, mesh),
    )


def _bracket(chosen_ms: float, sensor: ActiveSensor) -> tuple[float, float, float]:
    """Return an exposure time well below the chosen one, itself, and one well above it."""
    shorter_ms = max(chosen_ms / _BRACKET, sensor.exposure.min_ms)
    longer_ms = min(chosen_ms * _BRACKET, sensor.exposure.max_ms)
    return sensor.nearest_exposure(shorter_ms), chosen_ms, sensor.nearest_exposure(longer_ms)


def _visible(views: tuple[FeatureView, ...]) -> tuple[FeatureView, ...]:
    return tuple(view for view in views if view.visibility is Visibility.VISIBLE)


def _measured(
    table: ObservationTable, forecast_: Forecast
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (features, exposures) of i_avg and p_norm, in a forecast's order."""
    rows = zip(
        table.names("feature"),
        table.array(["exposure_ms", "i_avg", "p_norm"]).tolist(),
        strict=True,
    )
    found = {(name, exposure_ms): values for name, (exposure_ms, *values) in rows}
    measured = np.array(
        [[found[name, own] for own in forecast_.exposures_ms] for name in forecast_.features]
    )
    return measured[..., 0], measured[..., 1]

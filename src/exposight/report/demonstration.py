"""The demonstration: a door in the simulated cell is measured, learnt, and met in a new view.

Some features train in views over three depth planes, others are never shown to the models. Then
the sensor stands where it never stood: exposures are recommended by prediction alone, and who will
fail is said; then they are taken, and what was promised is compared with what was achieved.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from exposight.cell import CampaignFolder, write_features
from exposight.errors import InputError
from exposight.files import make_folder
from exposight.measuring import measure
from exposight.models import (
    MODEL_SUFFIX,
    ModelSpecification,
    Predictor,
    model_named,
    save_model,
    train_all,
    train_window,
)
from exposight.observing import ObservationTable, View, Visibility, observe_campaign
from exposight.planning import CaptureCosts, Recommendation
from exposight.plans import PLANS, DepthPlane, MeasuringPlan
from exposight.report import campaign_summary, shown_view
from exposight.report.campaign_page import CampaignReport, sensor_facts
from exposight.report.part_plot import PartMesh
from exposight.report.recommendation_figure import recommendation_picture
from exposight.twin import SimulatedCell, scene_at
from exposight.twin.part import DOOR, MeshSettings, mesh_sheet
from exposight.workers import Progress, ignore_progress, usual_workers

_COMPARED = tuple(map(model_named, ("q_k1", "e_k6")))
_UNSEEN_SUFFIX = "_test"  # as the door's test features are called
_NEW_POSITION = DepthPlane(
    name="new",
    # Between the campaign's depth planes, and off the grid of each in x and y.
    z_tcp_mm=30.0,
    x_mm=(-60.0,),
    y_mm=(0.0,),
    exposures_ms=(1.0,),  # until they are chosen
)

_FRAMES, _OVERHEAD_MS = 12, 500.0
"""Of a capture: patterns that are projected, and what a capture takes beside (assumed)."""

_COARSE = MeshSettings(
    lattice_mm=7.0,
    fine_curvature_per_mm=0.03,
    rim_spacing_mm=2.0,
    border_spacing_mm=6.0,
    growth=1.4,
    arc_steps=1,
)
"""Some 50 000 triangles for one skin: enough for a picture, and quick to draw."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Promise:
    """What was recommended of a view, and what came of it.

    Parameters
    ----------
    recommended : Recommendation
        Before anything was taken.
    achieved : dict of str to float
        The best p_norm of each feature in the recommended captures.
    single_ms : float, ms
        The best single exposure time, by forecast.
    single : dict of str to float
        p_norm of each feature with it.
    """

    recommended: Recommendation
    achieved: dict[str, float]
    single_ms: float
    single: dict[str, float]

    @classmethod
    def kept_by(
        cls, recommended: Recommendation, single_ms: float, table: ObservationTable
    ) -> Promise:
        """Look up what the view's captures gave."""
        frame = table.measured().frame

        def best(times_ms: Collection[float]) -> dict[str, float]:
            rows = frame.filter(pl.col("exposure_ms").is_in(list(times_ms)))
            return dict(rows.group_by("feature").agg(pl.col("p_norm").max()).iter_rows())

        return cls(
            recommended=recommended,
            achieved=best(recommended.exposures_ms),
            single_ms=single_ms,
            single=best([single_ms]),
        )

    @property
    def n_achieved(self) -> int:
        """Features that reached the quality."""
        return sum(each >= self.recommended.need for each in self.achieved.values())

    @property
    def n_single(self) -> int:
        """Features that reach it with the best single exposure time."""
        return sum(each >= self.recommended.need for each in self.single.values())

    @property
    def failing(self) -> dict[str, str]:
        """Features that were said to fail, and why; of those not seen, the nearly seen ones."""
        said = {each.feature: each.reason for each in self.recommended.failing}
        return said | {
            name: reason
            for name, reason in self.recommended.hidden.items()
            if reason == Visibility.PARTLY_OUT_OF_FRAME.value
        }


@dataclass(frozen=True, kw_only=True)
class DemonstrationSettings:
    """What the demonstration does.

    Parameters
    ----------
    seed : int
        Random seed of noise, alignment errors and restarts.
    restarts : int
        Starts of the compared models' optimiser; the paper took three.
    compared : tuple of ModelSpecification
        The paper's models that are trained beside the default ones and forecast the same view: at
        least one for quality and one for exposure time.
    plan : MeasuringPlan
        The campaign. Its features whose names end in ``_test`` do not train.
    workers : int
        Processes that work at the same time.

    Raises
    ------
    InputError
        If no pair is compared, no feature is left to train or to evaluate on, or
        there is no restart or worker.
    """

    seed: int = 1
    restarts: int = 3
    compared: tuple[ModelSpecification, ...] = _COMPARED
    plan: MeasuringPlan = PLANS["demo"]
    workers: int = usual_workers()

    def __post_init__(self) -> None:
        if min(self.restarts, self.workers) < 1:
            msg = (
                "a demonstration needs at least 1 restart and 1 worker, got "
                f"{self.restarts} and {self.workers}"
            )
            raise InputError(msg)
        if {model.target for model in self.compared} != {"p_norm", "exposure_ms"}:
            names = ", ".join(model.name for model in self.compared)
            msg = (
                "the demonstration compares a quality model and an exposure-time model, got "
                f"{names or 'none'}; add the one that is missing"
            )
            raise InputError(msg)
        if not 0 < len(self.unseen) < len(self.plan.features):
            msg = (
                f"plan {self.plan.name!r}: the demonstration needs features that train and "
                f"features whose names end in {_UNSEEN_SUFFIX!r}, got "
                f"{', '.join(self.plan.features)}"
            )
            raise InputError(msg)

    @property
    def unseen(self) -> frozenset[str]:
        """The plan's features that do not train."""
        return frozenset(name for name in self.plan.features if name.endswith(_UNSEEN_SUFFIX))


def run_demonstration(
    output: str | Path,
    settings: DemonstrationSettings | None = None,
    progress: Progress = ignore_progress,
) -> CampaignReport:
    """Run the whole method on the simulated cell.

    Whatever was captured stays in ``output/campaign`` and ``output/new-view``; run again, only
    what is missing is made.

    Parameters
    ----------
    output : path
        Folder for campaign, observations and models; made if it is not there.
    settings : DemonstrationSettings, optional
        What to do.
    progress : Progress
        Receives what is done.

    Returns
    -------
    CampaignReport
        Of the campaign; its view is the new one. `CampaignReport.write` writes its page.

    Raises
    ------
    InputError
        If the folder holds a demonstration of other settings.
    """
    settings = settings or DemonstrationSettings()
    folder = make_folder(Path(output))
    progress("building the door", 0, 1)
    part = settings.plan.observed_part(scene_at(None).part)
    progress("building the door", 1, 1)
    plan = replace(settings.plan, seed=settings.seed)
    campaign = _simulate(
        plan,
        folder / "campaign",
        "measuring the door",
        progress,
        workers=settings.workers,
        rings_only=True,
    )
    write_features(folder / "features.csv", part.features)
    table = observe_campaign(campaign, progress=progress)
    table.write(folder / "observations.csv")
    unseen = settings.unseen
    known = table.where(~np.isin(table.names("feature"), list(unseen)))
    source = f"plan {plan.name!r} on the simulated cell"
    progress("training the default models", 0, 1)
    quality = train_window(known, sensor=campaign.sensor, source=source)
    progress("training the default models", 1, 1)
    compared = train_all(
        settings.compared,
        known,
        seed=settings.seed,
        source=source,
        sensor=campaign.sensor,
        restarts=settings.restarts,
        workers=settings.workers,
        progress=progress,
    )
    models: tuple[Predictor, ...] = (quality, quality.radiance, *compared)
    make_folder(folder / "models")
    for model in models:
        save_model(folder / "models" / f"{model.name}{MODEL_SUFFIX}", model)
    promise, view = _new_view(plan, folder / "new-view", campaign, models, progress)
    return _report(settings, campaign, table, models, unseen, promise, view)


def door_mesh() -> PartMesh:
    """Mesh the door's inner skin coarsely: the same shape, holes and all."""
    sheet = mesh_sheet(DOOR, _COARSE)
    used, faces = np.unique(sheet.faces[~sheet.outer], return_inverse=True)
    return PartMesh(
        vertices=sheet.vertices[used].astype(np.float32),
        faces=faces.reshape(-1, 3).astype(np.int32),
    )


def _simulate(
    plan: MeasuringPlan,
    folder: Path,
    stage: str,
    progress: Progress,
    *,
    workers: int = 1,
    rings_only: bool = False,
) -> CampaignFolder:
    try:
        return measure(
            plan,
            SimulatedCell.for_plan(plan, rings_only=rings_only),
            folder,
            workers=workers,
            progress=lambda _, done, total: progress(stage, done, total),
        )
    except InputError as error:
        msg = f"{error} (it may hold another demonstration, or one of another seed)"
        raise InputError(msg) from error


def _new_view(
    plan: MeasuringPlan,
    folder: Path,
    campaign: CampaignFolder,
    models: tuple[Predictor, ...],
    progress: Progress,
) -> tuple[Promise, shown_view.ShownView]:
    """Recommend exposures of a view, say who will fail, and only then take them."""
    sensor = campaign.sensor
    pairs = shown_view.forecasting_models(models)
    progress("forecasting a new view", 0, 1)
    # shares of views that are aligned by kinematics alone are of the campaign's planes
    settings = {name: each for name, each in plan.simulated.items() if name != "kinematic_share"}
    whole = scene_at(None).part
    flat = tuple(each.name for each in whole.features if each.kind != "sphere")
    plan = replace(
        plan,
        name="new view",
        features=tuple(name for name in flat if not name.endswith("_out")),
        planes=(_NEW_POSITION,),
        random=(),
        simulated=settings,
    )
    part = plan.observed_part(whole)
    (planned,) = plan.views(part)
    pose = SimulatedCell.for_plan(plan).reported_pose(planned.camera_from_part, planned.name)
    view = View.of(part, sensor, pose, name=planned.name)
    costs = CaptureCosts(frames=_FRAMES, overhead_ms=_OVERHEAD_MS)
    recommended = pairs[0].recommend(view, costs=costs)
    choice = pairs[0].forecast(view)
    single_ms = choice.best_exposure_ms()
    exposures_ms = tuple(sorted({*recommended.exposures_ms, single_ms}))
    forecasts = [
        (pair.forecast(view, choice.exposures_ms), pair.forecast(view, exposures_ms))
        for pair in pairs
    ]
    progress("forecasting a new view", 1, 1)
    plan = replace(plan, planes=(replace(_NEW_POSITION, exposures_ms=exposures_ms),))
    taken = _simulate(plan, folder, "taking the new view", progress)
    table = observe_campaign(taken, progress=progress)
    shown = shown_view.show_view(table, times_ms=exposures_ms, campaign=taken)
    promise = Promise.kept_by(recommended, single_ms, table)
    return promise, shown_view.with_forecasts(shown, pairs, forecasts)


def _report(
    settings: DemonstrationSettings,
    campaign: CampaignFolder,
    table: ObservationTable,
    models: tuple[Predictor, ...],
    unseen: frozenset[str],
    promise: Promise,
    view: shown_view.ShownView,
) -> CampaignReport:
    plan, summary = settings.plan, campaign_summary.summarise(table)
    results = campaign_summary.evaluate_models(models, table, unseen)
    times = summary.exposures_ms
    x, y, z = next(where.translation_mm for _, where in _NEW_POSITION.placements())
    learnt = {feature.name for feature in summary.features if feature.name not in unseen}
    unseen = unseen | ({*view.features} - learnt)
    trained = [feature.name for feature in summary.features if feature.name not in unseen]
    return CampaignReport(
        title="A car door: which exposures to take, and which features will fail",
        lead="Demonstration of exposight in a simulated measuring cell.",
        table=table,
        summary=summary,
        view=view,
        results=results,
        unseen=unseen,
        sensor=campaign.sensor,
        mesh=door_mesh(),
        facts=(
            (
                "measuring plan",
                f"{plan.name}: {summary.views} views, {len(campaign)} captures, "
                f"{times[0]:.3g} to {times[-1]:.3g} ms; only the rings’ neighbourhoods taken",
            ),
            ("features that trained", ", ".join(sorted(trained))),
            (
                "new view",
                f"feature {plan.reference} at x {x:g}, y {y:g}, z {z:g} mm in the sensor’s TCP "
                "frame; whole frames",
            ),
            ("seed", f"{settings.seed} (noise, alignment errors, restarts)"),
            ("starts of the optimiser for each model", str(settings.restarts)),
            *sensor_facts(campaign.sensor),
        ),
        template="demonstration.html",
        content={
            "view_words": "the new view",
            "view_title": "The new view, at these exposure times and the best single one",
            "evaluated": len(settings.unseen),
            "promise": promise,
            "promise_figure": recommendation_picture(promise.recommended, promise.achieved),
            "trained": trained,
            "example": _example(view),
            "command": "exposight demo"
            + ("" if plan.name == DemonstrationSettings().plan.name else " --quick")
            + f" --seed {settings.seed}",
        },
    )


def _example(view: shown_view.ShownView) -> dict[str, object]:
    """Return what both pairs say at the chosen time where the paper's know least."""
    ours, paper = (forecast.taken for forecast in view.forecasts)
    width = (paper.p_norm_high - paper.p_norm_low)[:, view.main]
    place = int(width.argmax()), view.main
    return {
        "feature": view.features[place[0]],
        "exposure_ms": view.exposures_ms[view.main],
        "measured": float(view.p_norm[place]),
        **{
            name: tuple(
                float(values[place]) for values in (each.p_norm, each.p_norm_low, each.p_norm_high)
            )
            for name, each in (("ours", ours), ("paper", paper))
        },
    }

"""What the live page shows of a run, as JSON."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from exposight.cell import CampaignFolder
from exposight.measuring.record import EXPOSURE_PLAN_FILE
from exposight.planning import ExposurePlan, read_exposure_plan
from exposight.service.faults import answer, fault_answers
from exposight.service.folder import ServedFolder
from exposight.service.run_files import RUN_NAME, RunFolder, events_after
from exposight.service.run_work import plan_of
from exposight.service.runs import Runs
from exposight.service.shown_run import ShownRun, feature_names
from exposight.service.shown_surface import read_surface

router = APIRouter()

RunName = Annotated[str, Path(description="Of the run.", pattern=f"^{RUN_NAME}$")]


@router.get("/v1/runs/{name}/scene", responses=fault_answers(404))
def scene(name: RunName, request: Request) -> Response:
    """Return a run's features with what is known of each, its views, and the part's surface.

    ``status`` of a feature is had, open, failed, or unseen, where no view of the plan sees it;
    ``p_norm`` is the best that was measured, ``predicted`` the chance that the plan gives it.
    """
    folder = _run_folder(request, name)
    return answer(_shown(request, folder).scene(read_surface(folder.path)))


@router.get("/v1/runs/{name}/curve", responses=fault_answers(404))
def curve(
    name: RunName,
    request: Request,
    feature: Annotated[str, Query(max_length=255, description="Name of the feature.")],
    view: Annotated[str | None, Query(max_length=255, description="By default the best.")] = None,
) -> Response:
    """Return a feature's p_norm over exposure time: forecast, chosen times, measured points."""
    return answer(_shown(request, _run_folder(request, name)).curve(feature, view))


def _run_folder(request: Request, name: str) -> RunFolder:
    runs: Runs = request.app.state.runs
    return runs.run(name)


def _shown(request: Request, folder: RunFolder) -> ShownRun:
    """Return a run as it stands on disk now."""
    served: ServedFolder = request.app.state.folder
    asked, state = folder.request, folder.state
    promised = folder.campaign / EXPOSURE_PLAN_FILE  # as it was when the run began
    plan = read_exposure_plan(promised) if promised.is_file() else plan_of(asked, served)
    there = (folder.campaign / "campaign.json").is_file()
    events, _ = events_after(folder.events, 0)
    outcomes = {
        row["feature"]: row
        for event in events
        if event.kind == "outcomes"
        for row in event.data.get("outcomes", ())
    }
    return ShownRun(
        features=feature_names(plan),
        campaign=CampaignFolder(folder.campaign) if there else None,
        plan=plan if isinstance(plan, ExposurePlan) else None,
        models=None if asked.models is None else served.models(asked.models),
        outcomes=outcomes,
        ended=state.state == "finished",
    )

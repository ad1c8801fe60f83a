"""What the service has: its health, and models, parts and plans by name."""

from __future__ import annotations

import time
from typing import Any

from fastapi import APIRouter, Request, Response

from exposight import __version__
from exposight.errors import ExposightError, MissingFileError
from exposight.service.answers import EXAMPLES
from exposight.service.faults import answer, fault_answers
from exposight.service.folder import Listing, ServedFolder

router = APIRouter(tags=["listings"])


def _answers(name: str) -> dict[int | str, dict[str, Any]]:
    content = {"application/json": {"example": EXAMPLES[name]}}
    return {200: {"description": "The answer.", "content": content}, **fault_answers()}


@router.get("/v1/health", responses=_answers("health"))
def health(request: Request) -> Response:
    """Return that the service is there, its version, and how much it serves."""
    state = request.app.state
    folder: ServedFolder = state.folder
    try:
        status, listing = "ok", vars(folder.listing())
    except MissingFileError:
        status, listing = "folder missing", vars(Listing())
    return answer(
        {
            "status": status,
            "version": __version__,
            "uptime_s": time.time() - state.started,
            "warm": state.warm,
            "serves": {kind: len(names) for kind, names in listing.items()},
        }
    )


@router.get("/v1/models", responses=_answers("models"))
def models(request: Request) -> Response:
    """List the models that are served, with what they predict."""
    folder: ServedFolder = request.app.state.folder
    return answer({"models": [_models(folder, name) for name in folder.listing().models]})


def _models(folder: ServedFolder, name: str) -> dict[str, Any]:
    try:
        found = folder.models(name)
    except ExposightError as error:  # one that cannot be used does not hide the others
        return {"name": name, "sensor": None, "models": [], "fault": folder.without_root(error)}
    sensor = None if found.sensor is None else found.sensor.name
    return {"name": name, "sensor": sensor, "models": found.table.frame.to_dicts()}


@router.get("/v1/parts", responses=_answers("parts"))
def parts(request: Request) -> Response:
    """List the parts that are served, by campaign and by list of features, and the sensors."""
    folder: ServedFolder = request.app.state.folder
    listing = folder.listing()
    rows = [_part(folder, "campaign", name) for name in listing.campaigns]
    rows += [_part(folder, "features", name) for name in listing.features]
    return answer({"parts": rows, "sensors": listing.sensors})


def _part(folder: ServedFolder, kind: str, name: str) -> dict[str, Any]:
    try:
        part = folder.campaign(name).part if kind == "campaign" else folder.features(name)
    except ExposightError as error:
        fault = folder.without_root(error)
        return {"name": name, "kind": kind, "part": None, "features": [], "fault": fault}
    names = [each.name for each in part.features]
    return {"name": name, "kind": kind, "part": part.name, "features": names}


@router.get("/v1/plans", responses=_answers("plans"))
def plans(request: Request) -> Response:
    """List the exposure plans and measuring plans that are served."""
    folder: ServedFolder = request.app.state.folder
    listing = folder.listing()
    return answer(
        {"exposure_plans": listing.exposure_plans, "measuring_plans": listing.measuring_plans}
    )

"""What the service has: its health, and models, parts and plans by name."""

from __future__ import annotations

import time

from fastapi import APIRouter, Request, Response

from exposight import __version__
from exposight.service.faults import answer, fault_answers
from exposight.service.folder import ServedFolder

router = APIRouter()


@router.get("/v1/health", responses=fault_answers())
def health(request: Request) -> Response:
    """Return that the service is there, its version, and how much it serves."""
    state = request.app.state
    folder: ServedFolder = state.folder
    listing = vars(folder.listing())
    return answer(
        {
            "status": "ok",
            "version": __version__,
            "uptime_s": time.time() - state.started,
            "warm": state.warm,
            "serves": {kind: len(names) for kind, names in listing.items()},
        }
    )

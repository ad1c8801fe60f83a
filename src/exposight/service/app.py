"""The service as an ASGI application."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI

from exposight import __version__
from exposight.service import (
    campaign_routes,
    capture_routes,
    listing_routes,
    live_page,
    question_routes,
    run_routes,
    shown_routes,
)
from exposight.service.computing import Computing
from exposight.service.faults import add_fault_handlers
from exposight.service.folder import ServedFolder
from exposight.service.guard import Guard, Limits
from exposight.service.runs import Runs

_ABOUT = """Predicts the point-cloud quality and the exposure time of active 3D sensors.

Lengths are in mm, angles in degrees, exposure times in ms unless a key says otherwise, grey levels
0 to 255 and p_norm 0 to 1. Models, campaigns and plans are named by their path in the served
folder.
"""


def create_app(folder: Path, *, limits: Limits | None = None, token: str | None = None) -> FastAPI:
    """Return the service of a folder.

    Parameters
    ----------
    folder : Path
        What is served: models, campaigns, plans, lists of features and sensors beneath it.
    limits : Limits, optional
        What a request may take.
    token : str, optional
        What clients must send; without one only requests to loopback hosts are answered.

    Raises
    ------
    MissingFileError
        If the folder is not there.
    """
    limits = limits or Limits()
    app = FastAPI(
        title="exposight",
        version=__version__,
        description=_ABOUT,
        lifespan=_lifespan,
        docs_url=None,  # their pages load scripts from other addresses
        redoc_url=None,
    )
    app.state.folder = ServedFolder(folder)
    app.state.runs = Runs(app.state.folder)
    app.state.limits = limits
    app.state.computing = Computing(limits)
    app.state.started = time.time()
    app.state.warm = False
    add_fault_handlers(app)
    for routes in (
        listing_routes,
        question_routes,
        capture_routes,
        run_routes,
        campaign_routes,
        shown_routes,
        live_page,
    ):
        app.include_router(routes.router)
    app.add_middleware(Guard, limits=limits, token=token)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Load what is served and compile what is used, before the first request."""
    app.state.folder.warm_up()
    live_page.assets()
    app.state.warm = True
    yield
    app.state.runs.close()
    app.state.computing.close()

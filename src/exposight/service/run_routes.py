"""Measuring runs over HTTP: start, watch, pause, continue, stop, report."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from exposight.errors import FileError
from exposight.service.faults import answer, fault_answers
from exposight.service.json_routes import StrictRoute
from exposight.service.run_files import (
    Event,
    RunFolder,
    RunRequest,
    RunState,
    events_after,
    events_from,
)
from exposight.service.run_report import report_page
from exposight.service.runs import Runs

router = APIRouter(tags=["runs"], route_class=StrictRoute)

_LOOK_S = 0.1
"""Between looks for new events."""

_HEARTBEAT_S = 10.0

_MOST_EVENTS = 5000
"""In one answer."""


class RunList(BaseModel):
    """All runs."""

    runs: list[RunState] = Field(description="Those begun last first.")


class RunEvents(BaseModel):
    """What happened in a run after an event that the client knows."""

    events: list[Event] = Field(description="In their order; more follow after the last of many.")
    state: RunState = Field(description="How the run stands.")


After = Annotated[
    int, Query(ge=0, le=2**53, description="Number of the last event that is known; 0 for all.")
]


def _runs(request: Request) -> Runs:
    runs: Runs = request.app.state.runs
    return runs


@router.post(
    "/v1/runs",
    status_code=201,
    response_model=RunState,
    responses=fault_answers(404, 409, 429),
)
def start_run(request: Request, wanted: RunRequest) -> Response:
    """Start a run: a plan is carried out by a driver, and its campaign grows in the served folder.

    Of two clients that ask for the same name one starts it; the other is answered 409 with its
    state, whether or not the requests are the same.
    """
    return answer(vars(_runs(request).start(wanted)), 201)


@router.get("/v1/runs", response_model=RunList, responses=fault_answers())
def list_runs(request: Request) -> Response:
    """Return all runs, those begun last first."""
    return answer({"runs": [vars(each) for each in _runs(request).states()]})


@router.get("/v1/runs/{name}", response_model=RunState, responses=fault_answers(404))
def run_state(request: Request, name: str) -> Response:
    """Return how a run stands."""
    return answer(vars(_runs(request).run(name).state))


@router.post("/v1/runs/{name}/pause", response_model=RunState, responses=fault_answers(404, 409))
def pause_run(request: Request, name: str) -> Response:
    """Pause a run before its next capture; pausing a paused one changes nothing."""
    return answer(vars(_runs(request).order(name, "pause")))


@router.post("/v1/runs/{name}/stop", response_model=RunState, responses=fault_answers(404, 409))
def stop_run(request: Request, name: str) -> Response:
    """Stop a run before its next capture. What was captured stays, and it can be continued."""
    return answer(vars(_runs(request).order(name, "stop")))


@router.post(
    "/v1/runs/{name}/continue", response_model=RunState, responses=fault_answers(404, 409, 429)
)
def continue_run(request: Request, name: str) -> Response:
    """Let a run go on that is paused, stopped, interrupted or failed.

    No capture is lost and none is taken again; continuing one that runs changes nothing.
    """
    return answer(vars(_runs(request).proceed(name)))


@router.get("/v1/runs/{name}/events", response_model=RunEvents, responses=fault_answers(404))
def run_events(
    request: Request,
    name: str,
    after: After = 0,
    limit: Annotated[int, Query(ge=1, le=_MOST_EVENTS, description="Events at most.")] = 1000,
) -> Response:
    """Return what happened in a run after an event that the client knows."""
    run = _runs(request).run(name)
    state = run.state  # before the events, so that these are not older
    events, _ = events_after(run.events, after)
    return answer({"events": [vars(each) for each in events[:limit]], "state": vars(state)})


@router.get(
    "/v1/runs/{name}/stream",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "Server-sent events: messages are events with their number as id; "
            "events of type run are the run's state whenever it changes.",
            "content": {"text/event-stream": {"schema": {"type": "string"}}},
        },
        **fault_answers(404),
    },
)
def stream_run(
    request: Request,
    name: str,
    after: After = 0,
    last_event_id: Annotated[
        str | None,
        Header(description="As browsers send it when they connect again; overrules `after`."),
    ] = None,
) -> StreamingResponse:
    """Send what happens in a run as it happens, until the client leaves."""
    run = _runs(request).run(name)
    known = (last_event_id or "").strip()
    if known.isascii() and known.isdigit() and len(known) < 17:
        after = int(known)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_messages(run, after), media_type="text/event-stream", headers=headers)


async def _messages(run: RunFolder, after: int) -> AsyncIterator[str]:
    """Yield a run's events and changes of state in the form of server-sent events."""
    loop = asyncio.get_running_loop()
    events, offset = await asyncio.to_thread(events_after, run.events, after)
    shown, said_at = "", loop.time()
    yield "retry: 1000\n\n"
    while True:
        lines = [f"id: {each.seq}\ndata: {_json(each)}\n\n" for each in events]
        try:
            state = _json(run.state)
        except FileError:  # somebody removed the run
            return
        if state != shown:
            lines.append(f"event: run\ndata: {state}\n\n")
            shown = state
        if not lines and loop.time() - said_at > _HEARTBEAT_S:
            lines.append(": still there\n\n")
        if lines:
            said_at = loop.time()
            yield "".join(lines)
        await asyncio.sleep(_LOOK_S)
        events, offset = events_from(run.events, offset)


def _json(value: Event | RunState) -> str:
    return json.dumps(vars(value), ensure_ascii=False, separators=(",", ":"))


@router.get(
    "/v1/runs/{name}/report",
    response_class=Response,
    responses={
        200: {"description": "A page.", "content": {"text/html": {"schema": {"type": "string"}}}},
        **fault_answers(404, 409),
    },
)
def run_report(request: Request, name: str) -> Response:
    """Return a page about what was captured so far, with the run's models evaluated on it."""
    state = request.app.state
    page = report_page(_runs(request).run(name), state.folder, state.limits.request_s)
    return Response(page, media_type="text/html; charset=utf-8")

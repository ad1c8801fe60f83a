"""What models are asked over HTTP: forecast, recommend and plan."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

from exposight.service.answers import EXAMPLES
from exposight.service.computing import Computing
from exposight.service.faults import answer, fault_answers
from exposight.service.json_routes import StrictRoute
from exposight.service.questions import ForecastQuestion, PlanQuestion, RecommendQuestion

router = APIRouter(route_class=StrictRoute, tags=["questions"])


def answers(name: str, *statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return descriptions of an endpoint's answers, with an example of the good one."""
    content = {"application/json": {"example": EXAMPLES[name]}}
    return {
        200: {"description": "The answer.", "content": content},
        **fault_answers(404, 415, 429, *statuses),
    }


@router.post("/v1/forecast", responses=answers("forecast"))
async def forecast(question: ForecastQuestion, request: Request) -> Response:
    """Forecast the quality of every feature that a pose sees, over exposure time."""
    return await _computed(question, request)


@router.post("/v1/recommend", responses=answers("recommend"))
async def recommend(question: RecommendQuestion, request: Request) -> Response:
    """Recommend the exposures of a view, and name the features that will fail."""
    return await _computed(question, request)


@router.post("/v1/plan", responses=answers("plan", 409))
async def plan(question: PlanQuestion, request: Request) -> Response:
    """Plan which exposures to take in which views of a part; the answer holds the plan's file."""
    return await _computed(question, request)


async def _computed(
    question: ForecastQuestion | RecommendQuestion | PlanQuestion, request: Request
) -> Response:
    state = request.app.state
    computing: Computing = state.computing
    return answer(await computing.run(question.answer, state.folder, state.limits))

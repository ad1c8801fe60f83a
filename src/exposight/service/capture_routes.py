"""What captures that are sent tell: observed at once, or fed to a closed loop."""

from __future__ import annotations

from typing import Any, TypeVar

from fastapi import APIRouter, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError

from exposight.service.answers import EXAMPLES
from exposight.service.computing import Computing
from exposight.service.faults import answer, fault_answers
from exposight.service.guard import Limits
from exposight.service.json_routes import beside, check_media_type, parsed_body
from exposight.service.loop_questions import NextQuestion
from exposight.service.observe_questions import ObserveQuestion
from exposight.service.uploads import uploaded

router = APIRouter(tags=["captures"])

_JSON, _MULTIPART = "application/json", "multipart/form-data"

_Question = TypeVar("_Question", bound=BaseModel)


def _schema(question: type[BaseModel]) -> dict[str, Any]:
    """Return a body's schema with all that it refers to in place."""
    schema = question.model_json_schema()
    defined = schema.pop("$defs", {})

    def inlined(value: Any) -> Any:
        if isinstance(value, list):
            return [inlined(each) for each in value]
        if not isinstance(value, dict):
            return value
        if "$ref" in value:
            referred = defined[value["$ref"].rpartition("/")[2]]
            value = {**referred, **{key: each for key, each in value.items() if key != "$ref"}}
        return {key: inlined(each) for key, each in value.items()}

    whole: dict[str, Any] = inlined(schema)
    return whole


def _multipart(question: type[BaseModel]) -> dict[str, Any]:
    file = {"type": "string", "format": "binary"}
    return {
        "schema": {
            "type": "object",
            "properties": {
                "about": _schema(question),
                "image": {**file, "description": "PNG, TIFF, BMP, JPEG or PGM."},
                "cloud": {**file, "description": "PLY, PCD, XYZ, CSV, NPZ, NPY or a depth image."},
            },
            "required": ["about", "image", "cloud"],
        },
        "encoding": {"about": {"contentType": _JSON}},
    }


def _answers(name: str, *statuses: int) -> dict[int | str, dict[str, Any]]:
    content = {_JSON: {"example": EXAMPLES[name]}}
    return {
        200: {"description": "The answer.", "content": content},
        **fault_answers(400, 404, 415, 429, *statuses),
    }


@router.post(
    "/v1/observe",
    responses=_answers("observe"),
    openapi_extra={
        "requestBody": {"required": True, "content": {_MULTIPART: _multipart(ObserveQuestion)}}
    },
)
async def observe(request: Request) -> Response:
    """Measure quality, brightness and pose of every feature in a capture."""
    check_media_type(request, _MULTIPART)
    state = request.app.state
    computing: Computing = state.computing
    async with uploaded(request) as upload:
        question = await _validated(ObserveQuestion, upload.about, request)
        found = await computing.run(question.answer, upload, state.folder, state.limits)
    return answer(found)


@router.post(
    "/v1/next",
    responses=_answers("next", 409),
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                _JSON: {"schema": _schema(NextQuestion)},
                _MULTIPART: _multipart(NextQuestion),
            },
        }
    },
)
async def next_capture(request: Request) -> Response:
    """Take note of what was captured, and say what to capture next: one step of a closed loop.

    Begin with plan, models and a campaign; then send each capture: its image and cloud as a
    multipart request, its observations, or the name of a campaign or table in the served folder.
    What was sent before is known already. One client at a time steps a loop; another is answered
    409 meanwhile.
    """
    state = request.app.state
    computing: Computing = state.computing
    if check_media_type(request, _JSON, _MULTIPART) == _JSON:
        question = await _validated(NextQuestion, await request.body(), request)
        return answer(await computing.run(question.answer, None, state.folder, state.limits))
    async with uploaded(request) as upload:
        question = await _validated(NextQuestion, upload.about, request)
        return answer(await computing.run(question.answer, upload, state.folder, state.limits))


async def _validated(question: type[_Question], body: bytes, request: Request) -> _Question:
    """Return a question; raise as FastAPI does for bodies that it validates itself."""

    def parse(body: bytes, limits: Limits) -> _Question:
        try:
            return question.model_validate(parsed_body(body, limits))
        except ValidationError as error:
            raise RequestValidationError(error.errors(include_url=False)) from error

    return await beside(request.app.state.computing, parse, body, request.app.state.limits)

"""What a client is answered that asks for something that cannot be: one form for every fault.

Faults of what was sent have a 4xx status. A 500 is a fault of exposight itself.
"""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Mapping, Sequence
from typing import Any, Self

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from exposight.errors import (
    AmbiguousError,
    ContradictionError,
    ExposightError,
    MissingFileError,
    OutOfMemoryError,
    did_you_mean,
    first_ten,
)

_logger = logging.getLogger(__name__)

_KINDS = {
    401: "NotAuthorised",
    403: "Forbidden",
    404: "NotFound",
    405: "MethodNotAllowed",
    408: "TimedOut",
    409: "Conflict",
    411: "LengthRequired",
    413: "TooLarge",
    414: "PathTooLong",
    415: "UnsupportedMediaType",
    429: "TooBusy",
}
"""Kinds of faults that no error of the library stands for."""

_MOST_ERRORS = 100
"""Errors of a body that are looked at."""

_DRIVERS = ("simulated", "replay", "genicam", "rc_visard")
"""Kinds of drivers, which pydantic names in the place of an error."""

_LONGEST_INPUT = 60
"""Characters of a value that a message quotes."""


class RequestError(ExposightError):
    """A request that is refused as such.

    Parameters
    ----------
    status : int
        Status of the answer, 400 to 499.
    message : str
    facts : mapping of str to object, optional
        What the message is about, for programs.
    """

    def __init__(
        self, status: int, message: str, facts: Mapping[str, object] | None = None
    ) -> None:
        super().__init__(message)
        self.status, self.facts = status, dict(facts or {})

    def named(self, message: str) -> Self:
        """Return the error with another message."""
        return type(self)(self.status, message, self.facts)


class Fault(BaseModel):
    """What is answered in place of what was asked for."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "error": "no models 'model' in the served folder; did you mean 'models'?",
                    "kind": "MissingFileError",
                    "facts": {},
                }
            ]
        }
    )

    error: str = Field(description="What was expected, what came, and what to do.")
    kind: str = Field(description="Name of the error, such as PoseError or NotAuthorised.")
    facts: dict[str, Any] = Field(description="What the message is about, for programs.")


_MEANINGS = {
    400: "The body is no multipart form, or a header is there twice.",
    401: "The token is missing or wrong.",
    403: "The request comes from a page of another origin, or names another host.",
    404: "Nothing of that name is in the served folder.",
    408: "The request did not arrive, or could not be answered, within the time limit.",
    409: "Another client is at it, or something else has that name already.",
    413: "The body, or something announced in it, is larger than the server takes.",
    415: "The body is of another type than expected.",
    422: "The body, or something that it names, cannot be right; the message says what.",
    429: "The server is busy with as many requests as it takes; ask again a little later.",
}


def fault_answers(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return descriptions of faults for OpenAPI; what every request can meet is among them."""
    every = sorted({401, 403, 408, 413, 422, *statuses})
    return {status: {"model": Fault, "description": _MEANINGS[status]} for status in every}


def answer(
    content: object, status: int = 200, headers: Mapping[str, str] | None = None
) -> Response:
    """Return an answer in JSON; floats are written so that they are read as the same numbers."""
    try:
        body = _dumped(content)
    except (TypeError, ValueError):  # infinite numbers, and types that JSON has not
        body = _dumped(_plain(content))
    return Response(
        body.encode("utf-8", "replace"),
        status_code=status,
        headers=None if headers is None else dict(headers),
        media_type="application/json",
    )


def _dumped(content: object) -> str:
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def fault(
    status: int, kind: str, message: str, facts: Mapping[str, object] | None = None
) -> Response:
    """Return the answer that says what is wrong."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return answer({"error": message, "kind": kind, "facts": dict(facts or {})}, status, headers)


def fault_of(error: ExposightError) -> Response:
    """Return the answer to what the library, or the service, refuses."""
    kind = type(error).__name__
    match error:
        case RequestError():
            return fault(error.status, _KINDS.get(error.status, kind), str(error), error.facts)
        case MissingFileError():
            return fault(404, kind, str(error))
        case OutOfMemoryError():
            return fault(413, kind, str(error))
        case ContradictionError():
            facts = {"contradictions": [_plain(vars(each)) for each in error.contradictions]}
            return fault(422, kind, str(error), facts)
        case AmbiguousError():
            return fault(422, kind, str(error), {"readings": list(error.readings)})
        case _:
            return fault(422, kind, str(error))


def add_fault_handlers(app: FastAPI) -> None:
    """Have an app answer every error in this form."""

    async def refused(request: Request, error: Exception) -> Response:
        assert isinstance(error, ExposightError)
        return fault_of(error.named(request.app.state.folder.without_root(error)))

    async def invalid(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return fault(422, "InputError", *_validation_message(error.errors()))

    async def http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        kind = _KINDS.get(error.status_code, "InputError")
        response = fault(error.status_code, kind, _http_message(request, error))
        response.headers.update(error.headers or {})
        return response

    async def left(request: Request, error: Exception) -> Response:
        return fault(400, "InputError", "the client left before the body had arrived")

    async def out_of_memory(request: Request, error: Exception) -> Response:
        message = "there is not enough memory for this; ask for less at once"
        return fault(413, "OutOfMemoryError", message)

    async def broken(request: Request, error: Exception) -> Response:
        _logger.error("%s %s", request.method, request.url.path, exc_info=error)
        message = (
            f"this is a fault of exposight, not of what was sent ({type(error).__name__}); the "
            "server's log has the traceback: please report it"
        )
        return fault(500, "InternalError", message)

    app.add_exception_handler(ExposightError, refused)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(ClientDisconnect, left)
    app.add_exception_handler(MemoryError, out_of_memory)
    app.add_exception_handler(Exception, broken)


def _http_message(request: Request, error: HTTPException) -> str:
    if error.status_code == 404:
        return f"there is nothing at {request.url.path}; /openapi.json lists what there is"
    if error.status_code == 405:
        return f"{request.url.path} does not take {request.method}; see /openapi.json"
    return str(error.detail)


def _validation_message(errors: Sequence[Any]) -> tuple[str, dict[str, object]]:
    """Return what is wrong with a body's keys in words, and the keys."""
    shown = errors[:_MOST_ERRORS]
    faults = [_validation_fault(each) for each in shown]
    keys = list(dict.fromkeys(_key(each["loc"]) for each in shown))
    return first_ten(faults), {"keys": keys}


def _validation_fault(error: Mapping[str, Any]) -> str:
    key, kind, context = _key(error["loc"]), error["type"], error.get("ctx", {})
    if kind == "missing":
        return f"key {key!r} is missing" if key else "the body is missing: expected a JSON object"
    if kind == "unknown_key":
        inner = f"{key}.{context['key']}".removeprefix(".")
        return f"key {inner!r} is unknown{context['hint']}"
    if kind == "extra_forbidden":
        return f"key {key!r} is unknown"
    if kind == "union_tag_not_found":
        return f"{key} needs its kind: {', '.join(_DRIVERS[:-1])} or {_DRIVERS[-1]}"
    got = _quoted(error.get("input"))
    shown = got if len(got) <= _LONGEST_INPUT else f"{got[:_LONGEST_INPUT]}…"
    words = error["msg"].removeprefix("Value error, ")
    words = words[:1].lower() + words[1:]
    hint = ""
    if kind == "literal_error" and isinstance(error["input"], str):
        hint = did_you_mean(error["input"][:_LONGEST_INPUT], re.findall("'(.*?)'", words))
    return f"key {key!r}: {words}, got {shown}{hint}"


def _quoted(value: Any) -> str:
    """Return a value as a message quotes it, without writing out a large one."""
    if isinstance(value, list | dict) and len(value) > _LONGEST_INPUT:
        return f"{type(value).__name__} of {len(value)}"
    return repr(value)


def _key(place: Sequence[str | int]) -> str:
    """Return a key as the body has it: views[2].pose."""
    key = ""
    for step in place:
        if step in {"body", "query", "path"} and not key:
            continue
        if key == ".driver" and step in _DRIVERS:
            continue
        key += f"[{step}]" if isinstance(step, int) else f".{step}"
    return key.removeprefix(".")


def _plain(value: Any) -> Any:
    """Return a record's values as JSON has them."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(each) for each in value]
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    return str(value)

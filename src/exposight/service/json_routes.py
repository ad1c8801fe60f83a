"""Routes whose bodies are JSON, read as strictly as documents in files are."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException

from exposight.errors import FormatError
from exposight.files import parse_json
from exposight.service.computing import Computing
from exposight.service.guard import Limits

_SMALL_BYTES = 64_000
"""Bodies up to here are parsed at once."""

_Parsed = TypeVar("_Parsed")


class StrictRequest(Request):
    """A request whose JSON has no key twice, no NaN, and is not nested too deeply."""

    async def json(self) -> Any:
        """Return the object in the body.

        Raises
        ------
        HTTPException
            422 if it is none.
        """
        state = self.app.state
        return await beside(state.computing, parsed_body, await self.body(), state.limits)


async def beside(
    computing: Computing, parse: Callable[[bytes, Limits], _Parsed], body: bytes, limits: Limits
) -> _Parsed:
    """Parse a body; the server's loop does not wait for one that takes longer."""
    if len(body) <= _SMALL_BYTES:
        return parse(body, limits)
    return await computing.run(parse, body, limits)


def parsed_body(body: bytes, limits: Limits) -> dict[str, Any]:
    """Return the object in a body, or raise an `HTTPException` that says why it is none."""
    n_values, n_objects = body.count(b","), body.count(b"{") + body.count(b"[")
    if n_values > limits.json_values or n_objects > limits.json_objects:
        msg = (
            f"the body has more than {limits.json_values} values, or {limits.json_objects} objects "
            "and lists, which are the most that are taken"
        )
        raise HTTPException(413, msg)
    try:
        return parse_json(body.decode("utf-8"), "the body")
    except UnicodeDecodeError as error:
        msg = "the body is not UTF-8 text; expected a JSON object"
        raise HTTPException(422, msg) from error
    except FormatError as error:
        raise HTTPException(422, str(error)) from error


class StrictRoute(APIRoute):
    """A route with a JSON body."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return what answers a request."""
        answer_strictly = super().get_route_handler()

        async def handle(request: Request) -> Response:
            if self.body_field is not None:
                check_media_type(request, "application/json")
            return await answer_strictly(StrictRequest(request.scope, request.receive))

        return handle


def check_media_type(request: Request, *expected: str) -> str:
    """Return the media type of a body, without its parameters.

    Raises
    ------
    HTTPException
        415 if it is another than expected.
    """
    given = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if given not in expected:
        msg = f"expected a body of type {' or '.join(expected)}, got {given or 'none'}"
        raise HTTPException(415, msg)
    return given

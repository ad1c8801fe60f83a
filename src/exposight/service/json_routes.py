"""Routes whose bodies are JSON, read as strictly as documents in files are."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException

from exposight.errors import FormatError
from exposight.files import parse_json


class StrictRequest(Request):
    """A request whose JSON has no key twice, no NaN, and is not nested too deeply."""

    async def json(self) -> Any:
        """Return the object in the body.

        Raises
        ------
        HTTPException
            422 if it is none.
        """
        return parsed_body(await self.body())


def parsed_body(body: bytes) -> dict[str, Any]:
    """Return the object in a body, or raise an `HTTPException` that says why it is none."""
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

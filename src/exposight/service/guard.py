"""What is looked at before a request is answered: who asks, from which page, and how much it sends.

A browser that shows a foreign page may send requests to this machine. Without a token the server
answers only those that name a loopback host and come from its own pages: a foreign page can neither
pass the first check by a name of its own that resolves to this machine (DNS rebinding), nor the
second one.
"""

from __future__ import annotations

import asyncio
import hmac
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from exposight.service.faults import fault

LEAST_TOKEN = 16
"""Characters of a token."""

TAKES_ROWS = "/v1/next"
"""Path whose bodies may hold the rows of an observation table."""

_LOOPBACK = {"localhost", "127.0.0.1", "::1"}

_SENT_ONCE = {b"host", b"origin", b"sec-fetch-site", b"authorization", b"content-length"}
"""Headers by which it is decided who is answered: of two nobody knows which is meant."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What one request may take.

    Parameters
    ----------
    body_bytes : int
        Size of a body, uploads included.
    json_bytes, rows_bytes : int
        Size of a body in JSON, and of one that may hold observations.
    json_values, json_objects : int
        Values in a body in JSON, and objects and lists among them, counted by its commas and
        brackets before it is parsed.
    path_chars : int
        Length of a path with its query.
    pixels : int
        Pixels of an image, looked at before it is decoded.
    points : int
        Points of a cloud in the form of campaigns' folders, where a missing one costs a bit.
    request_s : float, s
        Time for a body to arrive, and for its answer.
    busy : int
        Requests that one process computes at once.
    waiting : int
        Requests that wait for their turn; more are refused.
    features, views, exposures : int
        Features of a part, views of a plan, exposure times of a forecast.
    """

    body_bytes: int = 64_000_000
    json_bytes: int = 2_000_000
    rows_bytes: int = 8_000_000
    json_values: int = 500_000
    json_objects: int = 20_000
    path_chars: int = 2048
    pixels: int = 50_000_000
    points: int = 50_000_000
    request_s: float = 60.0
    busy: int = 2
    waiting: int = 32
    features: int = 2000
    views: int = 500
    exposures: int = 1000


class Guard:
    """ASGI middleware that refuses who may not ask, and bodies that are too large or too slow.

    Parameters
    ----------
    app : ASGI application
    limits : Limits
    token : str, optional
        What clients must send as ``Authorization: Bearer TOKEN``. Without one only loopback hosts
        and the server's own pages are answered.
    """

    def __init__(self, app: ASGIApp, limits: Limits, token: str | None = None) -> None:
        self._app, self._limits = app, limits
        self._bearer = None if token is None else f"Bearer {token}".encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            headers = dict(scope["headers"])
            most_bytes = self._most_bytes(scope["path"], headers)
            refused = self._refusal(scope, headers, most_bytes)
            if refused is None:
                body = _LimitedBody(receive, self._limits.request_s, most_bytes)
                await self._app(_as_get(scope), body.receive, send)
            else:
                await fault(*refused)(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 1008})

    def _most_bytes(self, path: str, headers: dict[bytes, bytes]) -> int:
        """Return how large a request's body may be: uploads are larger than what is parsed."""
        limits = self._limits
        if headers.get(b"content-type", b"").lower().startswith(b"multipart/"):
            return limits.body_bytes
        parsed = limits.rows_bytes if path == TAKES_ROWS else limits.json_bytes
        return min(parsed, limits.body_bytes)

    def _refusal(
        self, scope: Scope, headers: dict[bytes, bytes], most_bytes: int
    ) -> tuple[int, str, str] | None:
        """Return why a request is not answered: status, kind and message."""
        names = [name for name, _ in scope["headers"] if name in _SENT_ONCE]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1).decode()
            return 400, "InputError", f"the header {twice} is there more than once"
        length = len(scope.get("raw_path") or b"") + len(scope.get("query_string") or b"")
        if length > self._limits.path_chars:
            most = self._limits.path_chars
            return 414, "PathTooLong", f"the path has {length} characters, and up to {most} may be"
        if self._bearer is not None:
            given = headers.get(b"authorization", b"")
            if not is_open(scope["path"]) and not hmac.compare_digest(given, self._bearer):
                return 401, "NotAuthorised", "a valid token is needed: Authorization: Bearer TOKEN"
        elif not _is_loopback(headers.get(b"host", b"")):
            message = "without a token the server answers requests to localhost alone"
            return 403, "Forbidden", message
        if not _same_origin(headers):
            return 403, "Forbidden", "the request comes from a page of another origin"
        announced = headers.get(b"content-length", b"")
        if announced.isdigit() and int(announced[:20]) > most_bytes:
            return 413, "TooLarge", _too_large_message(most_bytes)
        return None


def _as_get(scope: Scope) -> Scope:
    """Return a HEAD as the GET that it asks about; the server leaves out the answer's body.

    An endless stream has no answer whose length could be told.
    """
    if scope["method"] != "HEAD" or scope["path"].endswith("/stream"):
        return scope
    return {**scope, "method": "GET"}


def is_open(path: str) -> bool:
    """Tell whether a path is answered without a token: the live page's frame, which holds no data.

    Browsers cannot send a token when a page is opened; the page asks for it, and sends it with
    every request for data.
    """
    return path == "/" or path.startswith("/assets/")


def _is_loopback(host: bytes) -> bool:
    try:
        name = urlsplit(f"//{host.decode('ascii')}").hostname
    except ValueError:
        return False
    return name in _LOOPBACK


def _same_origin(headers: dict[bytes, bytes]) -> bool:
    """Tell whether a request comes from this server's page, or from no browser."""
    if headers.get(b"sec-fetch-site", b"none") not in {b"none", b"same-origin"}:
        return False
    origin = headers.get(b"origin")
    if origin is None:
        return True
    try:
        return urlsplit(origin.decode("ascii")).netloc.encode() == headers.get(b"host")
    except ValueError:
        return False


def _too_large_message(most_bytes: int) -> str:
    return f"the body has more than {most_bytes / 1e6:g} MB, which is the most that is taken"


class _LimitedBody:
    """A body as it arrives, up to a size and within a time."""

    def __init__(self, receive: Receive, request_s: float, most_bytes: int) -> None:
        self._receive, self._request_s, self._most_bytes = receive, request_s, most_bytes
        self._bytes, self._complete = 0, False
        self._deadline: float | None = None

    async def receive(self) -> Message:
        """Return the next piece.

        Raises
        ------
        HTTPException
            413 where the body is too large, 408 where it does not arrive.
        """
        if self._complete:  # what comes next says that the client has left, whenever it does
            return await self._receive()
        loop = asyncio.get_running_loop()
        if self._deadline is None:
            self._deadline = loop.time() + self._request_s
        try:
            async with asyncio.timeout_at(self._deadline):
                message = await self._receive()
        except TimeoutError as error:
            msg = f"the body did not arrive within {self._request_s:g} s"
            raise HTTPException(408, msg, {"Connection": "close"}) from error
        self._bytes += len(message.get("body", b""))
        self._complete = not message.get("more_body", False)
        if self._bytes > self._most_bytes:
            message_words = _too_large_message(self._most_bytes)
            raise HTTPException(413, message_words, {"Connection": "close"})
        return message

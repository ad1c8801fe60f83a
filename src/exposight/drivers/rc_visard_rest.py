"""Requests to an rc_visard's REST interface, version 2: JSON over HTTP, each with a deadline."""

from __future__ import annotations

import http.client
import json
import logging
import time
from dataclasses import dataclass
from typing import Any, Literal

from exposight.errors import InputError, SensorError

logger = logging.getLogger(__name__)

_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 5.0
"""Between a request that was refused as one too many and the next try."""

_LARGEST_ANSWER = 4_000_000

_FIRST_IMAGE_PORT = 50051
"""Of pipeline 0; each further one has the next."""

OutputMode = Literal["Low", "High", "ExposureActive", "ExposureAlternateActive"]


@dataclass(frozen=True, kw_only=True)
class RcVisardSettings:
    """Where an rc_visard is, and how long it is waited for.

    Parameters
    ----------
    host : str
        Its address or name.
    port : int
        Of its REST interface.
    pipeline : int
        Of an rc_cube with several sensors, from 0.
    image_port : int, optional
        Of its image interface; 50051 + pipeline by default.
    projector : {"Low", "High", "ExposureActive", "ExposureAlternateActive"}, optional
        Mode of output 1, to which the projector is connected; left as it is by default.
    timeout_s : float, s
        How long an answer to one request may take.
    images_timeout_s : float, s
        How long the image set of a new exposure time may take.
    tries : int
        How often a request is made that the device refused as one too many, or whose connection
        broke.

    Raises
    ------
    InputError
        If a value makes no sense.
    """

    host: str
    port: int = 80
    pipeline: int = 0
    image_port: int | None = None
    projector: OutputMode | None = None
    timeout_s: float = 5.0
    images_timeout_s: float = 20.0
    tries: int = 6

    def __post_init__(self) -> None:
        ports = (self.port, self.images_at)
        if not self.host.strip() or any(c in self.host for c in "/@?# \r\n"):
            msg = f"an rc_visard needs its host, an address or a name alone, got {self.host!r}"
            raise InputError(msg)
        if self.pipeline < 0 or not all(0 < port < 65536 for port in ports):
            msg = f"ports are from 1 to 65535 and pipelines from 0, got {ports} and {self.pipeline}"
            raise InputError(msg)
        if not (self.timeout_s > 0 and self.images_timeout_s > 0 and self.tries > 0):
            msg = "timeout_s and images_timeout_s must be above 0 s, and tries from 1 up"
            raise InputError(msg)

    @property
    def images_at(self) -> int:
        """Port of the image interface."""
        return self.image_port or _FIRST_IMAGE_PORT + self.pipeline


class RestApi:
    """The REST interface of a device; a connection for each request.

    Parameters
    ----------
    settings : RcVisardSettings
    """

    def __init__(self, settings: RcVisardSettings) -> None:
        self._settings = settings
        self._device = f"rc_visard at {settings.host}:{settings.port}"

    def get(self, path: str) -> Any:
        """Return what ``GET /api/v2/<path>`` answers.

        Raises
        ------
        SensorError
            If the device does not answer in time, refuses, or answers an error.
        """
        return self._request("GET", path, None)

    def put(self, path: str, value: object) -> Any:
        """Return what ``PUT /api/v2/<path>`` of a JSON value answers; raises as `get`."""
        return self._request("PUT", path, value)

    def _request(self, method: str, path: str, value: object) -> Any:
        """Make a request until it is answered, but for those that it would not help to repeat."""
        pause_s = _FIRST_PAUSE_S
        for left in reversed(range(self._settings.tries)):
            try:
                status, after_s, content = self._answer(method, path, value)
            except (ConnectionResetError, BrokenPipeError, http.client.HTTPException) as error:
                reason = f"the connection broke ({type(error).__name__})"
            except TimeoutError as error:
                msg = f"no answer within {self._settings.timeout_s:g} s"
                raise self._failed(method, path, msg) from error
            except OSError as error:
                msg = f"it cannot be reached ({error}): check address, cable and power"
                raise self._failed(method, path, msg) from error
            else:
                if status != http.client.TOO_MANY_REQUESTS:
                    return self._content(method, path, status, content)
                reason = "it refuses requests as too many (429): what else is talking to it?"
                pause_s = max(pause_s, after_s)
            if left:
                time.sleep(min(pause_s, _LONGEST_PAUSE_S))
                pause_s *= 2
        raise self._failed(method, path, f"{reason}, {self._settings.tries} times")

    def _answer(self, method: str, path: str, value: object) -> tuple[int, float, bytes]:
        """Return status, seconds to wait before another request, and content."""
        timeout_s = self._settings.timeout_s
        deadline = time.monotonic() + timeout_s
        connection = http.client.HTTPConnection(
            self._settings.host, self._settings.port, timeout=timeout_s
        )
        try:
            body = None if value is None else json.dumps(value)
            headers = {"Content-Type": "application/json", "Accept": "application/json"}
            connection.request(method, f"/api/v2/{path}", body, headers)
            response = connection.getresponse()
            content = b""
            while piece := response.read1(65536):
                content += piece
                if time.monotonic() > deadline:
                    raise TimeoutError
                if len(content) > _LARGEST_ANSWER:
                    msg = f"its answer is longer than {_LARGEST_ANSWER} bytes"
                    raise self._failed(method, path, msg)
            if response.length:  # bytes announced that did not come
                raise http.client.IncompleteRead(content, response.length)
            return response.status, _seconds(response.getheader("Retry-After")), content
        finally:
            connection.close()

    def _content(self, method: str, path: str, status: int, content: bytes) -> Any:
        try:
            answer = json.loads(content)
        except ValueError:
            answer = None
        if status >= 400:
            said = answer.get("message") if isinstance(answer, dict) else None
            msg = f"it answered {status} {http.client.responses.get(status, '')}: {said or '-'}"
            if status == http.client.FORBIDDEN:
                msg += "; does a GigE Vision client hold it, or is a licence missing?"
            raise self._failed(method, path, msg)
        if answer is None:
            raise self._failed(method, path, f"its answer ({status}) is not JSON")
        self._check_return_code(method, path, answer)
        return answer

    def _check_return_code(self, method: str, path: str, answer: Any) -> None:
        """Notice that a request was answered, and failed: negative codes are errors."""
        within = answer.get("response", answer) if isinstance(answer, dict) else {}
        code = within.get("return_code") if isinstance(within, dict) else None
        if not isinstance(code, dict) or not code.get("value"):
            return
        text = f"return code {code['value']}: {code.get('message') or 'no message'}"
        if isinstance(code["value"], int) and code["value"] > 0:
            logger.warning("%s, %s %s: %s", self._device, method, path, text)
            return
        raise self._failed(method, path, text)

    def _failed(self, method: str, path: str, why: str) -> SensorError:
        return SensorError(f"{self._device}: {method} {path}: {why}")


def _seconds(header: str | None) -> float:
    """Return the seconds of a Retry-After; dates are not worth it."""
    return float(header) if header and header.isdigit() else 0.0

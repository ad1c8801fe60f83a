"""The service's Python client: a method for each endpoint, the library's own errors."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, Self
from urllib.parse import quote

import httpx

from exposight import errors
from exposight.errors import (
    AmbiguousError,
    ContradictionError,
    ExposightError,
    MissingFileError,
    PoseError,
)
from exposight.geometry import RigidTransform

_Pose = RigidTransform | Sequence[Sequence[float]]


class ServiceError(ExposightError):
    """A request was refused for a reason that no error of the library stands for.

    Parameters
    ----------
    message : str
    kind : str
        Such as NotAuthorised, TooBusy or Conflict.
    status : int
        Status of the answer; 0 where there was none.
    """

    def __init__(self, message: str, kind: str = "", status: int = 0) -> None:
        super().__init__(message)
        self.kind, self.status = kind, status


class Client:
    """Asks a server that ``exposight serve`` runs.

    Answers are what the endpoints return (docs/service.md), parsed. Every method raises what the
    library raises for the same input, and `ServiceError` where the request was refused as such, or
    the server cannot be reached.

    Parameters
    ----------
    url : str
        Address of the server, ``http://127.0.0.1:8765``.
    token : str, optional
        What the server was started with.
    timeout_s : float, s
        Longest wait for an answer.
    """

    def __init__(self, url: str, token: str | None = None, *, timeout_s: float = 60.0) -> None:
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._http = httpx.Client(base_url=url, headers=headers, timeout=timeout_s, trust_env=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    # -- what is served -------------------------------------------------------------------------

    def health(self) -> dict[str, Any]:
        """Return the server's version, uptime, and how much it serves."""
        return self._get("/v1/health")

    def models(self) -> list[dict[str, Any]]:
        """Return the models that are served."""
        return self._list("/v1/models", "models")

    def parts(self) -> list[dict[str, Any]]:
        """Return the parts that are served."""
        return self._list("/v1/parts", "parts")

    def plans(self) -> dict[str, Any]:
        """Return the names of the plans that are served."""
        return self._get("/v1/plans")

    # -- questions ------------------------------------------------------------------------------

    def forecast(
        self, models: str, *, camera_from_part: _Pose | None = None, **about: Any
    ) -> dict[str, Any]:
        """Forecast the quality of every feature that a pose sees, over exposure time.

        Parameters
        ----------
        models : str
            Name of the models.
        camera_from_part : RigidTransform or (4, 4) sequence, mm, optional
            Pose of the part in the camera's frame.
        **about
            Further keys of the request: campaign, view, at_least, exposures_ms, …
        """
        return self._post("/v1/forecast", _body(about, models, camera_from_part))

    def recommend(
        self, models: str, *, camera_from_part: _Pose | None = None, **about: Any
    ) -> dict[str, Any]:
        """Recommend the exposures of a view; parameters as for `forecast`."""
        return self._post("/v1/recommend", _body(about, models, camera_from_part))

    def plan(
        self, models: str, *, views: Mapping[str, _Pose] | None = None, **about: Any
    ) -> dict[str, Any]:
        """Plan which exposures to take in which views.

        Parameters
        ----------
        models : str
            Name of the models.
        views : mapping of str to pose, optional
            camera_from_part of the views to choose from; those of the campaign by default.
        **about
            Further keys of the request: campaign, goal, budget, save_as, …
        """
        if views is not None:
            about["views"] = [
                {"name": name, "camera_from_part": _matrix(pose)} for name, pose in views.items()
            ]
        return self._post("/v1/plan", _body(about, models, None))

    # -- captures -------------------------------------------------------------------------------

    def observe(
        self, image: Path, cloud: Path, *, camera_from_part: _Pose | None = None, **about: Any
    ) -> dict[str, Any]:
        """Measure every feature in a capture.

        Parameters
        ----------
        image, cloud : Path
            The capture's files.
        camera_from_part : RigidTransform or (4, 4) sequence, mm, optional
            Pose of the part in the camera's frame.
        **about
            Further keys of the request: campaign, exposure_ms, view, files, …
        """
        body = _body(about, None, camera_from_part)
        return self._upload("/v1/observe", body, Path(image), Path(cloud))

    def next(
        self,
        loop: str,
        *,
        image: Path | None = None,
        cloud: Path | None = None,
        camera_from_part: _Pose | None = None,
        **about: Any,
    ) -> dict[str, Any]:
        """Send what was captured to a closed loop, and return what to capture next.

        Parameters
        ----------
        loop : str
            Name of the loop. To begin it give plan, models and campaign.
        image, cloud : Path, optional
            Files of a capture; with them exposure_ms, as read back.
        camera_from_part : RigidTransform or (4, 4) sequence, mm, optional
            Its pose; by default where it was asked for.
        **about
            Further keys of the request: captures, observations, unit, …
        """
        body = {"loop": loop, **_body(about, about.get("models"), camera_from_part)}
        if image is None or cloud is None:
            return self._post("/v1/next", body)
        return self._upload("/v1/next", body, Path(image), Path(cloud))

    # -- runs -----------------------------------------------------------------------------------

    def runs(self) -> list[dict[str, Any]]:
        """Return the states of all measuring runs."""
        return self._list("/v1/runs", "runs")

    def run(self, name: str) -> dict[str, Any]:
        """Return the state of a run."""
        return self._get(f"/v1/runs/{quote(name)}")

    def start_run(self, name: str, **about: Any) -> dict[str, Any]:
        """Start a measuring run: plan, models, driver and clouds as the endpoint takes them."""
        return self._post("/v1/runs", {"name": name, **about})

    def pause_run(self, name: str) -> dict[str, Any]:
        """Pause a run after the capture that is being taken."""
        return self._post(f"/v1/runs/{quote(name)}/pause", {})

    def continue_run(self, name: str) -> dict[str, Any]:
        """Go on with a run that is paused, stopped, interrupted or has failed."""
        return self._post(f"/v1/runs/{quote(name)}/continue", {})

    def stop_run(self, name: str) -> dict[str, Any]:
        """Stop a run; what was captured stays."""
        return self._post(f"/v1/runs/{quote(name)}/stop", {})

    def events(self, name: str, *, after: int = 0) -> dict[str, Any]:
        """Return a run's events after a number, and its state."""
        return self._get(f"/v1/runs/{quote(name)}/events", after=after)

    def stream(self, name: str, *, after: int = 0) -> Iterator[dict[str, Any]]:
        """Yield a run's events as they happen, until the server ends the stream."""
        path, parameters = f"/v1/runs/{quote(name)}/stream", {"after": after}
        with self._http.stream("GET", path, params=parameters) as response:
            if response.is_error:
                response.read()
                raise _error_of(response)
            for line in response.iter_lines():
                if line.startswith("data:"):
                    yield json.loads(line.removeprefix("data:"))

    def run_report(self, name: str) -> str:
        """Return the page about a run's campaign, HTML."""
        return self._ask("GET", f"/v1/runs/{quote(name)}/report").text

    # -- campaigns ------------------------------------------------------------------------------

    def campaigns(self) -> list[dict[str, Any]]:
        """Return the campaigns that are served, with their views and exposure times."""
        return self._list("/v1/campaigns", "campaigns")

    def campaign(self, name: str) -> dict[str, Any]:
        """Return what a campaign holds."""
        return self._get(f"/v1/campaigns/{quote(name)}")

    def captures(self, campaign: str) -> list[dict[str, Any]]:
        """Return number, view, exposure time and pose of a campaign's captures."""
        found: Any = self._get(f"/v1/campaigns/{quote(campaign)}/captures")
        return list(found["captures"] if isinstance(found, dict) else found)

    def capture_image(self, campaign: str, number: int, *, width: int | None = None) -> bytes:
        """Return the picture of a capture, PNG or JPEG."""
        path = f"/v1/campaigns/{quote(campaign)}/captures/{number}/image"
        return self._ask("GET", path, params={} if width is None else {"width": width}).content

    def capture_rings(self, campaign: str, number: int) -> dict[str, Any]:
        """Return the rings of a capture's features in its image."""
        return self._get(f"/v1/campaigns/{quote(campaign)}/captures/{number}/rings")

    def observations(self, campaign: str) -> list[dict[str, Any]]:
        """Return the rows of a campaign's observation table."""
        found: Any = self._get(f"/v1/campaigns/{quote(campaign)}/observations")
        return list(found["observations"] if isinstance(found, dict) else found)

    # -- requests -------------------------------------------------------------------------------

    def _get(self, path: str, **parameters: Any) -> dict[str, Any]:
        return _parsed(self._ask("GET", path, params=parameters))

    def _list(self, path: str, key: str) -> list[dict[str, Any]]:
        return list(self._get(path)[key])

    def _post(self, path: str, body: Mapping[str, Any]) -> dict[str, Any]:
        return _parsed(self._ask("POST", path, json=body))

    def _upload(
        self, path: str, body: Mapping[str, Any], image: Path, cloud: Path
    ) -> dict[str, Any]:
        with ExitStack() as stack:
            files = {
                name: (file.name, stack.enter_context(_opened(file, name)))
                for name, file in (("image", image), ("cloud", cloud))
            }
            about = {"about": json.dumps(body)}
            return _parsed(self._ask("POST", path, data=about, files=files))

    def _ask(self, method: str, path: str, **request: Any) -> httpx.Response:
        try:
            response = self._http.request(method, path, **request)
        except httpx.TransportError as error:
            reason = str(error) or type(error).__name__
            msg = f"no answer from {self._http.base_url}: {reason}; is the server running there?"
            raise ServiceError(msg) from error
        if response.is_error:
            raise _error_of(response)
        return response


def _body(about: Mapping[str, Any], models: str | None, pose: _Pose | None) -> dict[str, Any]:
    body = dict(about)
    if models is not None:
        body["models"] = models
    if pose is not None:
        body["camera_from_part"] = _matrix(pose)
    return body


def _matrix(pose: _Pose) -> list[list[float]]:
    rows = pose.to_matrix() if isinstance(pose, RigidTransform) else pose
    matrix = [list(map(float, row)) for row in rows]
    if not all(math.isfinite(each) for row in matrix for each in row):
        msg = f"a pose has finite numbers, got {matrix}"
        raise PoseError(msg)
    return matrix


def _opened(file: Path, what: str) -> BinaryIO:
    try:
        return file.open("rb")
    except OSError as error:
        msg = f"cannot read the {what} {file}: {error.strerror}"
        raise MissingFileError(msg) from error


def _parsed(response: httpx.Response) -> dict[str, Any]:
    found: dict[str, Any] = response.json()
    return found


def _error_of(response: httpx.Response) -> ExposightError:
    """Return the error that an answer stands for."""
    try:
        fault = response.json()
        message, kind, facts = fault["error"], fault["kind"], fault.get("facts", {})
    except (ValueError, KeyError, TypeError):
        message = f"the server answered {response.status_code}, not in the form of exposight"
        return ServiceError(message, status=response.status_code)
    if kind == ContradictionError.__name__:
        from exposight.contradictions import Contradiction

        found = (Contradiction(**each) for each in facts.get("contradictions", ()))
        return ContradictionError(message, tuple(found))
    if kind == AmbiguousError.__name__:
        return AmbiguousError(message, tuple(facts.get("readings", ())))
    known = getattr(errors, kind, None)
    if isinstance(known, type) and issubclass(known, ExposightError):
        return known(message)
    return ServiceError(message, kind, response.status_code)

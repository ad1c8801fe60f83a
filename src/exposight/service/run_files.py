"""A measuring run on disk: what was asked for, how it stands, what happened, who works on it.

Several server processes and the process that measures share these files and nothing else. A lock,
which the system lets go of when a process dies, tells whether anybody measures.
"""

from __future__ import annotations

import json
import math
import os
import sys
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from exposight.errors import FileError, InputError, MissingFileError
from exposight.files import DocumentFormat, read_bytes, write_durably

RUN_NAME = r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}"
"""Of a run: a plain name of a folder."""

RUNS = "runs"
"""Folder of the runs in the served folder."""

CAMPAIGN = "campaign"
"""Folder of a run's captures."""

_REQUEST, _STATE, _EVENTS, _ORDER, _LOCK = (
    "run.json",
    "state.json",
    "events.jsonl",
    "order",
    "run.lock",
)
_BLOCK = 65_536
"""Bytes of the end of the events that are read first."""

_STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

Name = Annotated[str, Field(min_length=1, max_length=255)]
"""Path of something in the served folder, relative to it."""


class SimulatedDriver(BaseModel):
    """The simulated cell takes the captures."""

    model_config = _STRICT

    kind: Literal["simulated"]
    lamp_power: Annotated[float, Field(gt=0, le=100)] | None = Field(
        default=None, description="Power of the projector's lamp as a share of the nominal one."
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = Field(
        default=None, description="Random seed with an exposure plan; 0 by default."
    )
    finish: Annotated[str, Field(max_length=64)] | None = Field(
        default=None, description="Finish of the part: bare, primer, paint or brushed."
    )
    rings_only: bool = Field(
        default=False, description="Simulate the neighbourhoods of the features' rings alone."
    )


class RecordedDriver(BaseModel):
    """A recorded campaign gives back its captures."""

    model_config = _STRICT

    kind: Literal["replay"]
    recording: Name = Field(description="Name of the campaign in the served folder.")


class CellDriver(BaseModel):
    """The devices of a cell's file take the captures."""

    model_config = _STRICT

    kind: Literal["genicam", "rc_visard"]
    cell: Name = Field(description="Name of the cell's file (.toml) in the served folder.")


DriverRequest = Annotated[
    SimulatedDriver | RecordedDriver | CellDriver, Field(discriminator="kind")
]


class RunRequest(BaseModel):
    """What a run measures, who decides, and who takes the captures."""

    model_config = ConfigDict(
        **_STRICT,
        json_schema_extra={
            "examples": [
                {
                    "name": "monday",
                    "plan": "plan.json",
                    "models": "models",
                    "driver": {"kind": "simulated", "lamp_power": 0.6},
                    "clouds": True,
                }
            ]
        },
    )

    name: Annotated[str, Field(pattern=f"^{RUN_NAME}$")] = Field(
        description="Of the run: letters, digits, '-', '_' and '.', at most 64."
    )
    plan: Name = Field(
        description="Exposure plan (.json), carried out in a closed loop, or measuring plan "
        "(.toml, .yaml), taken as it is; by its name in the served folder."
    )
    models: Name | None = Field(
        default=None,
        description="Models that correct an exposure plan by what captures show, by their name in "
        "the served folder; null takes its captures as they are.",
    )
    driver: DriverRequest = Field(description="Who takes the captures.")
    clouds: bool = Field(default=True, description="Whether point clouds are kept.")


RunStateName = Literal[
    "starting",
    "running",
    "paused",
    "stopping",
    "stopped",
    "interrupted",
    "failed",
    "finished",
]
LIVING = frozenset({"starting", "running", "paused", "stopping"})
"""States in which a process works on the run."""


@dataclass(frozen=True, kw_only=True)
class RunState:
    """How a run stands."""

    name: Annotated[str, Field(description="Of the run.")]
    state: Annotated[
        RunStateName,
        Field(
            description="Interrupted: whoever measured was killed. Stopped, interrupted and failed "
            "runs go on when they are continued; what was captured stays."
        ),
    ]
    plan: Annotated[str, Field(description="Name of the plan.")]
    models: Annotated[str | None, Field(description="Name of the models that decide.")]
    driver: Annotated[dict[str, Any], Field(description="Who takes the captures, as requested.")]
    campaign: Annotated[str, Field(description="Name of the campaign that grows.")]
    n_captures: Annotated[int, Field(description="Captures of which it is known what they gave.")]
    n_features: Annotated[int, Field(description="Features to measure.")]
    n_had: Annotated[
        int | None,
        Field(description="Features whose quality suffices; null with a measuring plan."),
    ]
    verdict: Annotated[str, Field(description="What came of it in a sentence, once finished.")]
    error: Annotated[str, Field(description="Why it failed or was interrupted; else empty.")]
    started: Annotated[str, Field(description="When it was requested, ISO 8601, UTC.")]
    updated: Annotated[str, Field(description="When this changed, ISO 8601, UTC.")]
    last_seq: Annotated[int, Field(description="Number of the newest event; 0 before the first.")]

    @property
    def lives(self) -> bool:
        """Whether a process works on it, by what was written last."""
        return self.state in LIVING


EventKind = Literal["state", "request", "decision", "outcomes", "progress", "error"]


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened in a run."""

    seq: Annotated[int, Field(description="Number of the event, from 1 up.")]
    time: Annotated[str, Field(description="When, ISO 8601, UTC.")]
    kind: Annotated[
        EventKind,
        Field(
            description="state: data.state is the new one. request: a capture that is about to be "
            "taken, with its view and exposure_ms. decision: what a capture gave. outcomes: "
            "features of which something became known. progress: data.done of data.total. error: "
            "why the run failed."
        ),
    ]
    text: Annotated[str, Field(description="In words.")]
    data: Annotated[dict[str, Any], Field(description="The same for programs.")]


_REQUESTS = DocumentFormat("exposight run", 1, RunRequest)
_STATES = DocumentFormat("exposight run state", 1, RunState)


def now() -> str:
    """Return the time in UTC, ISO 8601 with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@dataclass(frozen=True)
class RunFolder:
    """A run's folder.

    Parameters
    ----------
    path : Path
        Where it is.
    """

    path: Path

    @property
    def name(self) -> str:
        """The run's."""
        return self.path.name

    @property
    def campaign(self) -> Path:
        """Where its captures are."""
        return self.path / CAMPAIGN

    def is_run(self) -> bool:
        """Tell whether there is a run."""
        return (self.path / _STATE).is_file()

    @property
    def request(self) -> RunRequest:
        """What was asked for.

        Raises
        ------
        FileError
            If the file is missing or damaged.
        """
        path = self.path / _REQUEST
        return _REQUESTS.unseal(read_bytes(path, "run"), str(path))

    @property
    def written_state(self) -> RunState:
        """How it stood when this was last written; its process may have died since.

        Raises
        ------
        FileError
            If the file is missing or damaged.
        """
        path = self.path / _STATE
        return _STATES.from_bytes(read_bytes(path, "run's state"), str(path))

    @property
    def state(self) -> RunState:
        """How it stands, known from this file and the lock alone."""
        try:
            state = self.written_state
        except MissingFileError:
            raise
        except FileError as error:
            return self._damaged_state(str(error).replace(f"{self.path}/", ""))
        if not state.lives:
            return state
        if not self.is_held():
            state = self.written_state  # it may have ended properly in between
            if state.lives:
                reason = "the process that measured has ended with its server; continue to go on"
                return replace(state, state="interrupted", error=reason)
            return state
        return replace(state, state="stopping") if self.order() == "stop" else state

    def _damaged_state(self, reason: str) -> RunState:
        """Return how a run stands of which it is not known: failed, as was asked for."""
        try:
            asked = self.request
        except FileError:
            asked = None
        changed = datetime.fromtimestamp((self.path / _STATE).stat().st_mtime, UTC)
        return first_state(
            self.name,
            asked,
            state="failed",
            error=reason,
            time=changed.isoformat(timespec="milliseconds"),
        )

    def write(self, request: RunRequest, state: RunState) -> None:
        """Write what a new run's folder begins with."""
        write_durably(self.path / _REQUEST, _REQUESTS.seal(request))
        self.write_state(state)

    def write_state(self, state: RunState) -> None:
        """Replace what is known of how the run stands, durably."""
        write_durably(self.path / _STATE, _STATES.to_json(state).encode())

    def order(self) -> str:
        """Return what the process that measures is to do: ``run``, ``pause`` or ``stop``."""
        try:
            return (self.path / _ORDER).read_text("ascii", "replace")
        except OSError:
            return "run"

    def give_order(self, order: Literal["run", "pause", "stop"]) -> None:
        """Say what the process that measures is to do before its next capture."""
        write_durably(self.path / _ORDER, order.encode())

    @property
    def events(self) -> Path:
        """Where its events are."""
        return self.path / _EVENTS

    def take_lock(self) -> int | None:
        """Return the lock's descriptor, which a child may inherit; None where another holds it.

        Raises
        ------
        FileError
            If the disk has no locks.
        """
        return _locked(self.path / _LOCK, shared=False)

    def is_held(self) -> bool:
        """Tell whether a process works on the run."""
        if not (self.path / _LOCK).exists():
            return False
        descriptor = _locked(self.path / _LOCK, shared=True)
        if descriptor is None:
            return True
        os.close(descriptor)
        return False


def first_state(
    name: str,
    request: RunRequest | None,
    *,
    state: RunStateName = "starting",
    error: str = "",
    time: str,
    n_features: int = 0,
) -> RunState:
    """Return how a run stands of which nothing but its request is known, if that."""
    return RunState(
        name=name,
        state=state,
        plan=request.plan if request else "",
        models=request.models if request else None,
        driver=request.driver.model_dump(exclude_none=True) if request else {},
        campaign=f"{RUNS}/{name}/{CAMPAIGN}",
        n_captures=0,
        n_features=n_features,
        n_had=None,
        verdict="",
        error=error,
        started=time,
        updated=time,
        last_seq=0,
    )


def _locked(path: Path, *, shared: bool) -> int | None:
    if sys.platform == "win32":
        msg = "runs need locks that a child process inherits, which Windows lacks; use Linux"
        raise InputError(msg)
    import fcntl

    # Whoever only looks need not be able to write: the disk may be read-only.
    access = os.O_RDONLY if shared else os.O_RDWR | os.O_CREAT
    try:
        descriptor = os.open(path, access | os.O_CLOEXEC, 0o644)
    except OSError as error:
        msg = f"{path} cannot be opened: {error.strerror}"
        raise FileError(msg) from error
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    except OSError as error:
        os.close(descriptor)
        msg = f"{path} cannot be locked ({error.strerror}); serve a folder on a local disk"
        raise FileError(msg) from error
    return descriptor


class EventLog:
    """The events of a run, which its process appends to: one JSON object a line.

    What a killed process left of its last line is cut off when it is opened again.

    Parameters
    ----------
    path : Path
        The file; made if it is not there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self.before = _cut(self._descriptor)
        self._end = os.fstat(self._descriptor).st_size
        self.last_seq = self.before[-1].seq if self.before else 0

    def append(self, kind: EventKind, text: str, data: dict[str, Any]) -> Event:
        """Append an event, and return it.

        Raises
        ------
        OSError
            If the disk is full or refuses; nothing of it is then left in the file.
        """
        event = Event(seq=self.last_seq + 1, time=now(), kind=kind, text=text, data=_plain(data))
        line = json.dumps(vars(event), ensure_ascii=False).encode("utf-8", "replace") + b"\n"
        try:
            written = 0
            while written < len(line):
                written += os.write(self._descriptor, line[written:])
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            raise
        self._end += len(line)
        self.last_seq = event.seq
        return event


def _plain(value: Any) -> Any:
    """Return a value as JSON has it, which knows no number that is not finite."""
    match value:
        case dict():
            return {str(key): _plain(each) for key, each in value.items()}
        case list() | tuple():
            return [_plain(each) for each in value]
        case float():
            return float(value) if math.isfinite(value) else None
        case None | bool() | int() | str():
            return value
        case _:
            return str(value)


def _cut(descriptor: int) -> list[Event]:
    """Cut off what is no whole line at the end of events, and return those before."""
    data = bytearray()
    os.lseek(descriptor, 0, os.SEEK_SET)
    while block := os.read(descriptor, 1 << 20):
        data += block
    whole = data.rfind(b"\n") + 1
    if whole < len(data):
        os.ftruncate(descriptor, whole)
    return _parsed(bytes(data[:whole]))


def _parsed(data: bytes) -> list[Event]:
    """Return the events in whole lines; a line that a failing disk damaged is left out."""
    events = []
    for line in data.splitlines():
        try:
            events.append(Event(**json.loads(line)))
        except (ValueError, TypeError):
            continue
    return events


def events_after(path: Path, after: int) -> tuple[list[Event], int]:
    """Return the events after a number, and where in the file they end.

    No more of the file is read than its end that holds them.

    Parameters
    ----------
    path : Path
        Of the events; none where there is no file.
    after : int
        Number of the last event that is known.
    """
    try:
        with path.open("rb") as file:
            size = block = file.seek(0, os.SEEK_END)
            block = min(_BLOCK, size) if after > 0 else size
            while True:
                file.seek(size - block)
                data = file.read(block)
                events, end = _whole_lines(data, first=block < size)
                if block == size or (events and events[0].seq <= after + 1):
                    return [each for each in events if each.seq > after], size - block + end
                block = min(4 * block, size)
    except FileNotFoundError:
        return [], 0


def events_from(path: Path, offset: int) -> tuple[list[Event], int]:
    """Return the events from a place in the file on, and where they end."""
    try:
        with path.open("rb") as file:
            file.seek(offset)
            events, end = _whole_lines(file.read(), first=False)
            return events, offset + end
    except FileNotFoundError:
        return [], offset


def _whole_lines(data: bytes, *, first: bool) -> tuple[list[Event], int]:
    """Return events of whole lines and where these end; of a torn first line nothing."""
    start = data.find(b"\n") + 1 if first else 0
    end = data.rfind(b"\n") + 1
    return _parsed(data[start:end]), end

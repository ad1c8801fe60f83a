"""The process that carries out a run: measures, writes what happens, pauses and stops.

It ends when the server process that began it does, and holds the run's lock until then. Captures
are on disk before anything is said of them, so whatever ends it, the run goes on from there.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from exposight.cell import CampaignFolder, Capture, Driver, closing_driver
from exposight.errors import ExposightError, FileError
from exposight.geometry import RigidTransform
from exposight.measuring import measure, measure_adaptively
from exposight.measuring.decisions import HAD, Decision
from exposight.planning import ExposurePlan
from exposight.planning.loop_report import Outcome, Request
from exposight.service.folder import ServedFolder
from exposight.service.run_files import RUNS, EventKind, EventLog, RunFolder, RunStateName
from exposight.service.run_work import RunWork, run_work
from exposight.service.shown_surface import write_surface
from exposight.tables import number
from exposight.twin import SimulatedCell

_LOOK_S = 0.05
"""Between looks for the order to go on, while paused."""

_RESERVE, _RESERVE_BYTES = "reserve", 65_536
"""Given back when the disk is full, so that the run can say so."""


class _StoppedError(BaseException):
    """Ends a measurement between two captures; no driver's error, so that nobody handles it."""


class RunProcess:
    """A run that is being carried out.

    Parameters
    ----------
    folder : RunFolder
        The run's, whose lock this process holds.
    served : ServedFolder
        That the run is in.
    """

    def __init__(self, folder: RunFolder, served: ServedFolder) -> None:
        self._folder, self._served = folder, served
        self._log = EventLog(folder.events)
        self._state = folder.written_state
        noted = [each.data["number"] for each in self._log.before if each.kind == "decision"]
        self._noted = 1 + max(noted, default=-1)
        self._outcomes: dict[str, dict[str, Any]] = {}
        self._n_captures = self._state.n_captures

    def carry_out(self) -> None:
        """Measure until the run is finished, stopped or failed, and say which."""
        try:
            self._keep_reserve()
            resumed = self._log.last_seq > 0
            self._become("starting", "the run goes on" if resumed else "the run starts")
            work = run_work(self._folder.request, self._served)
            with closing_driver(work.driver):
                verdict = self._measure(work)
        except _StoppedError:
            self._become("stopped", f"stopped after {number(self._n_captures)} captures")
        except (ExposightError, OSError, MemoryError) as error:
            self._fail(str(error) or "there is not enough memory", type(error).__name__)
        except Exception as error:  # whatever a driver's own libraries raise when it is made
            self._fail(f"{type(error).__name__}: {error}", type(error).__name__)
        else:
            self._become("finished", verdict, verdict=verdict)

    def _measure(self, work: RunWork) -> str:
        """Carry out the plan, and return what came of it."""
        plan, campaign = work.plan, self._folder.campaign
        self._state = replace(self._state, n_features=len(plan.features))
        self._become("running", f"measuring with the {self._folder.request.driver.kind} driver")
        if isinstance(work.driver, SimulatedCell):
            scene = work.driver.scene
            write_surface(self._folder.path, scene.vertices, scene.part_faces)
        if isinstance(plan, ExposurePlan):
            result = measure_adaptively(
                plan,
                work.driver,
                campaign,
                models=work.models,
                clouds=work.clouds,
                tell=self._note_decision,
                ask=self._ask,
            )
            self._note_outcomes(result.outcomes)
            return result.verdict
        measured = measure(
            plan,
            _AskingDriver(work.driver, self),
            campaign,
            clouds=work.clouds,
            progress=self._note_progress,
            tell=lambda found: self._event("progress", str(found), {"contradiction": str(found)}),
        )
        return f"{number(len(measured))} captures of {number(len(plan.features))} features"

    # -- what happens ---------------------------------------------------------------------------

    def ask(self, view: str, exposure_ms: float, text: str, facts: Mapping[str, Any]) -> None:
        """Wait while the run is paused, then say which capture is about to be taken.

        Raises
        ------
        BaseException
            One that nobody handles, if the run is to stop.
        """
        while (order := self._folder.order()) != "run":
            if order == "stop":
                raise _StoppedError
            if self._state.state != "paused":
                self._become("paused", f"paused before view {view} at {number(exposure_ms)} ms")
            time.sleep(_LOOK_S)
        if self._state.state == "paused":
            self._become("running", "continued")
        self._event("request", text, {"view": view, "exposure_ms": exposure_ms, **facts})

    def _ask(self, request: Request, outcomes: Sequence[Outcome]) -> None:
        self._note_outcomes(outcomes)
        facts = {
            "set_value": request.set_value,
            "set_unit": request.set_unit,
            "features": list(request.features),
            "expected": request.expected,
            "why": request.why,
        }
        self.ask(request.view, request.exposure_ms, request.why, facts)

    def _note_decision(self, decision: Decision) -> None:
        """Say what a capture gave, unless that was said before an interruption."""
        self._n_captures = decision.number + 1
        if decision.number >= self._noted:
            self._event("decision", str(decision), asdict(decision))

    def _note_outcomes(self, outcomes: Sequence[Outcome]) -> None:
        """Say what became of features, of those alone where it is another than was said."""
        rows = {each.feature: asdict(each) for each in outcomes}
        news = [row for name, row in rows.items() if self._outcomes.get(name) != row]
        self._outcomes = rows
        if news:
            n_had = sum(each.status == HAD for each in outcomes)
            text = f"{number(n_had)} of {number(len(outcomes))} features succeeded"
            self._event("outcomes", text, {"outcomes": news}, n_had=n_had)

    def _note_progress(self, stage: str, done: int, total: int) -> None:
        if stage == "measuring":
            self._n_captures = done
        data = {"stage": stage, "done": done, "total": total}
        self._event("progress", f"{stage}: {number(done)} of {number(total)}", data)

    # -- what is written ------------------------------------------------------------------------

    def _event(self, kind: EventKind, text: str, data: dict[str, Any], **changes: Any) -> None:
        event = self._log.append(kind, self._served.without_root(text), self._without_root(data))
        self._state = replace(
            self._state,
            n_captures=self._n_captures,
            updated=event.time,
            last_seq=event.seq,
            **changes,
        )
        self._folder.write_state(self._state)

    def _without_root(self, value: Any) -> Any:
        """Return an event's data without the served folder's own path."""
        match value:
            case Mapping():
                return {key: self._without_root(each) for key, each in value.items()}
            case list() | tuple():
                return [self._without_root(each) for each in value]
            case str():
                return self._served.without_root(value)
            case _:
                return value

    def _become(self, state: RunStateName, text: str, **changes: Any) -> None:
        changes = {"error": "", **changes}
        self._event("state", text, {"state": state}, state=state, **changes)

    def _fail(self, message: str, kind: str) -> None:
        """Say why the run ends; where the disk is full, in the space that was kept for it."""
        message = self._served.without_root(message)
        with suppress(OSError):
            (self._folder.path / _RESERVE).unlink(missing_ok=True)
        with suppress(FileError):
            self._n_captures = len(CampaignFolder(self._folder.campaign))
        self._event("error", message, {"kind": kind}, error=message)
        self._become("failed", "failed; continue the run to go on", error=message)

    def _keep_reserve(self) -> None:
        path = self._folder.path / _RESERVE
        if not path.is_file() or path.stat().st_size < _RESERVE_BYTES:
            path.write_bytes(os.urandom(_RESERVE_BYTES))  # no file system compresses it away


class _AskingDriver:
    """A driver that asks before each capture, one after the other."""

    def __init__(self, driver: Driver, run: RunProcess) -> None:
        self._driver, self._run = driver, run

    def __getattr__(self, name: str) -> Any:
        if name == "concurrent":
            raise AttributeError(name)  # another process could not be paused
        return getattr(self._driver, name)

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        self._run.ask(view, exposure_ms, f"view {view} at {number(exposure_ms)} ms", {})
        return self._driver.capture(exposure_ms, camera_from_part, view=view)


def main(served: str, name: str, lock: str) -> None:
    """Carry out a run, as the server's process asks for it.

    Parameters
    ----------
    served : str
        The served folder.
    name : str
        The run's.
    lock : str
        Number of the inherited descriptor that holds the run's lock.
    """
    os.set_inheritable(int(lock), False)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # closes the driver on its way out
    folder = ServedFolder(Path(served))
    RunProcess(RunFolder(folder.root / RUNS / name), folder).carry_out()


if __name__ == "__main__":
    main(*sys.argv[1:])

"""The closed loop one step at a time over files, for programs that take captures themselves.

A state holds the plan and every capture's observations as they were fed. It is one file, which is
replaced as a whole: whatever happens, the old or the new one is there, and a call that was
interrupted can be repeated: a capture whose rows are all as they were fed is known already. The
models stay in their files, whose checksums the state knows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from exposight.cell import ActiveSensor, CampaignFolder, Part
from exposight.cell.capture import read_capture
from exposight.cell.feature_lists.feature_files import features_from_csv, features_to_csv
from exposight.contradictions import Contradiction
from exposight.errors import (
    FileError,
    FormatError,
    InputError,
    SensorError,
    did_you_mean,
    first_ten,
)
from exposight.files import (
    Checksum,
    DocumentFormat,
    csv_of,
    hold_writer_lock,
    read_bytes,
    sha256_of,
    write_durably,
)
from exposight.measuring.adaptive import observed_part, planned_loop, view_poses
from exposight.measuring.decisions import (
    Decision,
    Loop,
    exposure_remark,
    feed,
    pose_remark,
    verdict,
)
from exposight.observing import ObservationTable, Observer, parse_observations, read_observations
from exposight.planning import ExposurePlan, SensorModels, parse_exposure_plan
from exposight.planning.loop_report import Request
from exposight.tables import number


@dataclass(frozen=True, kw_only=True)
class FedCapture:
    """A capture that a state was fed.

    Parameters
    ----------
    view : str
    exposure_ms : float, ms
        As read back.
    observations : str
        An observation table, CSV.
    remark : str
        What is odd about it.
    sha256 : str
        Checksum of the capture's own description, by which it is known again; empty of a table's.
    """

    view: str
    exposure_ms: float
    observations: str
    remark: str = ""
    sha256: str = ""

    @property
    def rows(self) -> ObservationTable:
        """Its observations."""
        source = f"observations of view {self.view!r} at {self.exposure_ms:g} ms"
        table = parse_observations(self.observations.encode(), source)
        named = set(zip(table.frame["view"], table.frame["exposure_ms"], strict=True))
        if named != {(self.view, self.exposure_ms)}:
            msg = f"{source} hold rows of another capture: {first_ten(sorted(map(str, named)))}"
            raise FormatError(msg)
        return table


@dataclass(frozen=True, kw_only=True)
class LoopState:
    """Where a closed loop is, as its file says.

    Parameters
    ----------
    plan : str
        The exposure plan, a JSON document.
    sensor : str
        The sensor, a JSON document.
    part : str
        Name of the part.
    features : str
        The plan's features of the part, CSV.
    models : tuple of str
        Paths of the models, absolute.
    models_sha256 : mapping of str to str
        Checksum of each model's file by the model's name.
    captures : tuple of FedCapture
        What was fed, in its order.
    nothing_new : bool
        Whether a call since brought a known capture of the view that is asked for.
    """

    plan: str
    sensor: str
    part: str
    features: str
    models: tuple[str, ...]
    models_sha256: dict[str, Checksum]
    captures: tuple[FedCapture, ...] = field(default=())
    nothing_new: bool = False

    @property
    def begun(self) -> LoopState:
        """The state before any capture."""
        return replace(self, captures=(), nothing_new=False)

    @classmethod
    def begin(
        cls, plan: ExposurePlan, models: Sequence[Path], *, part: Part, sensor: ActiveSensor
    ) -> LoopState:
        """Return the state of a loop that begins with a plan.

        Raises
        ------
        SensorError
            If the plan is for another sensor.
        InputError, FileError
            If the part is another than the plan's or lacks a feature, or the models cannot be read.
        """
        if sensor.name != plan.sensor:
            msg = f"the plan is for sensor {plan.sensor!r}, got {sensor.name!r}"
            raise SensorError(msg)
        view_poses(plan)
        observed = observed_part(plan, part)
        return cls(
            plan=plan.to_json(),
            sensor=sensor.to_json(),
            part=observed.name,
            features=features_to_csv(observed.features),
            models=tuple(str(path.resolve()) for path in models),
            models_sha256=SensorModels.load(*models).checksums,
        )


_FORMAT = DocumentFormat("exposight loop state", 1, LoopState)


def read_state(path: Path) -> LoopState:
    """Read a state's file.

    Raises
    ------
    MissingFileError, DamagedFileError, FormatError, VersionError
        If it is not there, was changed, or is something else or newer.
    """
    return _FORMAT.unseal(read_bytes(path, "state of a loop"), str(path))


@contextmanager
def loop_step(path: Path) -> Iterator[LoopStep | None]:
    """Open a state for one step, for one process at a time; None where it is to begin.

    Raises
    ------
    FileError
        If another process has it open, or it is damaged.
    """
    path = Path(path)
    if not path.parent.is_dir():
        msg = f"{path}: the folder {path.parent} does not exist; make it first"
        raise FileError(msg)
    lock = hold_writer_lock(path.parent, f"the state {path.name}", f"{path.name}.lock")
    try:
        if path.is_file():
            yield LoopStep(path, read_state(path))
        else:
            yield None
    finally:
        lock.release()


class LoopStep:
    """A loop at the state of a file; what is fed is in the file after `save`.

    Parameters
    ----------
    path : Path
        The file.
    state : LoopState

    Raises
    ------
    FileError
        If the models are not those that the loop began with.
    """

    def __init__(self, path: Path, state: LoopState) -> None:
        self._path, self.state = path, state
        self.plan = parse_exposure_plan(state.plan, str(path))
        self.sensor = ActiveSensor.from_json(state.sensor, source=str(path))
        self.part = Part(name=state.part, features=features_from_csv(state.features, path))
        models = SensorModels.load(*state.models)
        if models.checksums != state.models_sha256:
            msg = (
                f"{path} began with other models than those that now lie at "
                f"{', '.join(state.models)}; put those back, or begin another state"
            )
            raise FileError(msg)
        self.loop: Loop = planned_loop(self.plan, models, self.part, self.sensor)
        self.decisions: list[Decision] = []
        self.known: list[str] = []
        self.contradictions: tuple[Contradiction, ...] = ()
        self._before = state
        for capture in state.captures:
            self._feed(capture)

    def request(self) -> Request | None:
        """Return what to capture next; None where nothing is left that can be had."""
        return self.loop.next()

    @property
    def verdict(self) -> str:
        """How many features succeeded of how many that were promised, and which failed."""
        return verdict(self.loop.outcomes, len(self.decisions), self.plan)

    def feed(self, path: Path) -> list[Decision]:
        """Take note of captures, one after the other.

        Those whose rows are all as they were fed before are left out and named in `known`; others
        of the same view and exposure time are captures that were repeated. Where the second call in
        a row brings a known capture of the view that is asked for, it is taken for a repeated one
        that shows the same to the last grey level, as clipped ones do: a sensor that does not take
        the exposure times asked for cannot keep the loop waiting.

        Parameters
        ----------
        path : Path
            A campaign's folder, a capture's folder, or an observation table, .csv or .parquet.

        Raises
        ------
        InputError
            If the plan has no such view, a capture has different rows of one feature, or there is
            no row of the plan's features.
        SensorError, ImageError, CloudError
            If a capture cannot be this sensor's.
        FileError
            If it cannot be read.
        """
        if (path / "campaign.json").is_file():
            campaign = CampaignFolder(path)
            if campaign.sensor.name != self.sensor.name:
                msg = (
                    f"{path} is of sensor {campaign.sensor.name!r}, the loop is of "
                    f"{self.sensor.name!r}; give captures of that one"
                )
                raise SensorError(msg)
            folders = [path / "captures" / f"{number:06d}" for number in campaign.numbers]
        elif path.is_dir():
            folders = [path]
        else:
            table = read_observations(path)
            self._note(table.contradictions)
            return self._feed_table(table)
        return [decision for each in folders if (decision := self._feed_folder(each))]

    def _feed_folder(self, folder: Path) -> Decision | None:
        description = read_bytes(folder / "capture.json", "capture")
        sha256 = sha256_of(description)
        for known in reversed(self.state.captures):
            if known.sha256 == sha256 and self._is_known(known):
                return None
        capture = read_capture(folder, self.sensor)
        self._check_view(capture.view)
        observer = Observer(self.part, self.sensor)
        rows = observer.observe(capture)
        self._note(observer.contradictions)
        pose = capture.camera_from_part
        remark = pose_remark(self.part, self.loop.next(), capture.view, pose)
        return self._add(ObservationTable.from_observations(rows), remark=remark, sha256=sha256)

    def _feed_table(self, table: ObservationTable) -> list[Decision]:
        names = [feature.name for feature in self.part.features]
        table = table.where(table.frame["feature"].is_in(names))
        table = ObservationTable(frame=table.frame.unique(maintain_order=True), checked=True)
        if len(table) == 0:
            msg = f"the table has no row of the plan's features, which are {', '.join(names)}"
            raise InputError(msg)
        captures = table.frame.partition_by("view", "exposure_ms", maintain_order=True)
        for frame in captures:
            twice = frame.filter(frame["feature"].is_duplicated())
            if twice.height:
                feature, view, ms = twice.select("feature", "view", "exposure_ms").row(0)
                msg = (
                    f"feature {feature!r} has two different rows in view {view!r} at {ms:g} ms; "
                    "feed repeated captures one after the other, each as a table of its own"
                )
                raise InputError(msg)
        added = [self._add(ObservationTable(frame=frame, checked=True)) for frame in captures]
        return [decision for decision in added if decision is not None]

    def _note(self, found: tuple[Contradiction, ...]) -> None:
        self.contradictions = tuple(dict.fromkeys((*self.contradictions, *found)))

    def save(self) -> None:
        """Write the state to its file, durably, unless it holds just this."""
        if self.state is not self._before or not self._path.is_file():
            write_durably(self._path, _FORMAT.seal(self.state))

    def _check_view(self, view: str) -> None:
        views = [each.name for each in self.plan.views]
        if view not in views:
            msg = f"the plan has no view {view!r}{did_you_mean(view, views)}"
            raise InputError(msg)

    def _add(
        self, table: ObservationTable, *, remark: str = "", sha256: str = ""
    ) -> Decision | None:
        """Take note of a capture's observations, unless they were fed before."""
        view, exposure_ms = str(table.frame["view"][0]), float(table.frame["exposure_ms"][0])
        self._check_view(view)
        increment_ms = self.sensor.exposure.increment_ms
        remarks = (exposure_remark(self.loop.next(), view, exposure_ms, increment_ms), remark)
        capture = FedCapture(
            view=view,
            exposure_ms=exposure_ms,
            observations=csv_of(table.frame).decode(),
            remark="; ".join(filter(None, remarks)),
            sha256=sha256,
        )
        for known in reversed(self.state.captures):
            alike = (known.view, known.exposure_ms) == (view, exposure_ms)
            if alike and _same_rows(known, capture) and self._is_known(known):
                return None
        self.state = replace(
            self.state, captures=(*self.state.captures, capture), nothing_new=False
        )
        return self._feed(capture)

    def _is_known(self, capture: FedCapture) -> bool:
        """Say that a capture is known already; False where it is to be taken for a new one."""
        request = self.loop.next()
        if request is not None and request.view == capture.view:
            if self._before.nothing_new and self._before.captures is self.state.captures:
                return False
            self.state = replace(self.state, nothing_new=True)
        line = f"known already: view {capture.view} at {number(capture.exposure_ms)} ms"
        if line not in self.known:
            self.known.append(line)
        return True

    def _feed(self, capture: FedCapture) -> Decision:
        request, place = self.loop.next(), len(self.decisions)
        self.decisions.append(feed(self.loop, place, capture.rows, request, capture.remark))
        return self.decisions[-1]


def _same_rows(one: FedCapture, other: FedCapture) -> bool:
    """Tell whether two captures' observations are the same in all columns, as they are kept."""
    if one.observations == other.observations:
        return True
    frame, another = (each.rows.frame.sort("feature") for each in (one, other))
    return set(frame.columns) == set(another.columns) and frame.equals(
        another.select(frame.columns)
    )

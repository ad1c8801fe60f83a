"""The plan of a part's exposures: captures in views, what they promise, and its file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import polars as pl

from exposight.cell import ActiveSensor, StoredPose
from exposight.errors import InputError, SensorError, did_you_mean
from exposight.files import Checksum, DocumentFormat, check_plain, read_text, write_durably
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.outlook import FeatureOutlook, PlannedExposure
from exposight.planning.outlook_table import failures, outlook_frame, outlook_table
from exposight.planning.path_search import Prefer
from exposight.plans import MeasuringPlan, PoseList
from exposight.tables import Column, Table, counted, number

Goal = Literal["count", "time"]

_CLOSE = 1e-6
"""Share by which two exposure times in a file may differ and be the same."""

_VIEW_COLUMNS = (
    Column(name="view"),
    Column(name="captures"),
    Column(name="exposures_ms", label="exposures\nms"),
    Column(name="set_to", label="set to"),
    Column(name="features", label="serves\nfeatures"),
)


@dataclass(frozen=True, kw_only=True)
class PlanView:
    """A view that is visited, and its captures.

    Parameters
    ----------
    name : str
    camera_from_part : RigidTransform or None
        Where the part shall stand; None where views are known by name alone.
    exposures : tuple of PlannedExposure
        In the order in which they are taken.
    """

    name: str
    camera_from_part: StoredPose | None
    exposures: tuple[PlannedExposure, ...]

    def __post_init__(self) -> None:
        check_plain(self.name, "the view", InputError)


@dataclass(frozen=True, kw_only=True)
class Promise:
    """What a plan promises of the features that it tries.

    Parameters
    ----------
    expected_covered : float
        How many of them are to be expected to succeed.
    expected_misses : float
        And how many not; features that are not planned are not among them.
    chance_of_all : float
        Chance that none of them fails: at least so much, however failures go together.
    chance_of_all_if_independent : float
        The same if failures had nothing to do with each other.
    correlation : str
        How dependence was treated.
    """

    expected_covered: float
    expected_misses: float
    chance_of_all: float
    chance_of_all_if_independent: float
    correlation: str


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """How good a plan is beside all others that serve each feature by one capture where one can.

    Several captures of a view together may do better; where a plan does, its own objective is the
    bound.

    Parameters
    ----------
    objective : float
        Captures, seconds, or, within a budget, features.
    bound : float
        No plan has fewer captures or takes less; or, within a budget, serves more features.
    unit : {"captures", "s", "features"}
    gap : float
        Share of the objective by which another plan could be better.
    proven : bool
        Whether none is.
    seconds : float, s
        What the search took by the wall clock.
    """

    objective: float
    bound: float
    unit: Literal["captures", "s", "features"]
    gap: float
    proven: bool
    seconds: float


@dataclass(frozen=True, kw_only=True)
class ModelReference:
    """A model that a plan rests on: its name, and the checksum of its file if it has one."""

    name: str
    sha256: Checksum | None = None


@dataclass(frozen=True, kw_only=True)
class ExposurePlan:
    """Captures of a part in several views.

    Parameters
    ----------
    sensor : str
        Name of the sensor.
    part : str
        Name of the part; may be empty.
    target_p_norm : float
        Quality that is asked for.
    confidence : float
        Chance that each feature shall have.
    expected_misses : float or None
        So many features at most shall be expected to fail, from which the confidence follows.
    goal : {"count", "time"}
        What there shall be least of.
    prefer : {"margin", "time"}
        Among the fewest captures: those with most margin, or those that take least.
    budget : float or None
        At most so many captures or, with the goal time, milliseconds.
    limits : ExposureLimits
        What the sensor can be set to.
    costs : CaptureCosts
        What captures and moves take.
    views : tuple of PlanView
        In the order in which they are visited.
    features : tuple of FeatureOutlook
        What becomes of each feature.
    promise : Promise
    certificate : Certificate
    models : tuple of ModelReference
        What predicted the chances.
    remarks : tuple of str
        What is odd about all of it.

    Raises
    ------
    InputError
        If names are there twice, a feature is planned where nothing is captured, or the quality or
        the confidence is none.
    """

    sensor: str
    part: str
    target_p_norm: float
    confidence: float
    expected_misses: float | None = None
    goal: Goal
    prefer: Prefer = "margin"
    budget: float | None = None
    limits: ExposureLimits
    costs: CaptureCosts
    views: tuple[PlanView, ...]
    features: tuple[FeatureOutlook, ...]
    promise: Promise
    certificate: Certificate
    models: tuple[ModelReference, ...] = ()
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if fault := self._fault():
            msg = f"exposure plan: {fault}"
            raise InputError(msg)

    def _fault(self) -> str:
        if not 0.0 < self.target_p_norm <= 1.0:
            return f"target_p_norm lies above 0 and at most at 1, got {self.target_p_norm:g}"
        if not 0.0 < self.confidence < 1.0:
            return f"confidence is a chance above 0 and below 1, got {self.confidence:g}"
        for kind, names in (
            ("view", [view.name for view in self.views]),
            ("feature", [each.feature for each in self.features]),
        ):
            if twice := sorted({name for name in names if names.count(name) > 1}):
                return f"{kind} {twice[0]!r} is there twice"
        for view in self.views:
            if not view.exposures:
                return f"view {view.name!r} has no exposure"
            for exposure in view.exposures:
                if fault := self._exposure_fault(exposure):
                    return f"view {view.name!r}: {fault}"
            orders = sorted(each.order for each in view.exposures)
            times = {each.exposure_ms for each in view.exposures}
            if orders != list(range(1, len(orders) + 1)) or len(times) < len(orders):
                return f"view {view.name!r}: its exposures are not numbered, or one is there twice"
        taken = {view.name: [each.exposure_ms for each in view.exposures] for view in self.views}
        for each in self.features:
            if not 0.0 <= each.chance <= 1.0:
                return f"feature {each.feature!r}: a chance lies between 0 and 1, got {each.chance}"
            planned = each.view is not None and each.exposure_ms is not None
            if planned and each.exposure_ms not in taken.get(each.view or "", []):
                return (
                    f"feature {each.feature!r} is planned in view {each.view!r} at "
                    f"{number(each.exposure_ms)} ms, where nothing is captured"
                )
        return self._promise_fault()

    def _promise_fault(self) -> str:
        """Return what of covers, promise and certificate cannot be."""
        known = {each.feature for each in self.features}
        covers = {name for view in self.views for each in view.exposures for name in each.covers}
        if unknown := covers - known:
            return f"an exposure covers {min(unknown)!r}, which is none of the features"
        promise, proof = self.promise, self.certificate
        most = len(known) + _CLOSE
        if not (0.0 <= promise.expected_covered <= most and 0.0 <= promise.expected_misses <= most):
            return f"of {len(known)} features no such number can be expected: {promise}"
        chances = promise.chance_of_all, promise.chance_of_all_if_independent
        if min(chances) < 0.0 or max(chances) > 1.0 + _CLOSE:
            return f"a chance lies between 0 and 1, got {promise}"
        if min(proof.objective, proof.bound, proof.gap, proof.seconds) < 0.0:
            return f"a certificate's numbers are 0 or more, got {proof}"
        wishes = [each for each in (self.budget, self.expected_misses) if each is not None]
        return (
            f"budget and expected misses are 0 or more, got {wishes}"
            if any(each < 0.0 for each in wishes)
            else ""
        )

    def _exposure_fault(self, exposure: PlannedExposure) -> str:
        limits, ms = self.limits, exposure.exposure_ms
        if not limits.allows(ms):
            return f"{limits.name} cannot be set to {number(ms, 6)} ms"
        if exposure.set_unit != limits.unit or not math.isclose(
            limits.exposure_ms(exposure.set_value), ms, rel_tol=_CLOSE
        ):
            return f"{number(ms, 6)} ms is not {exposure.set_value:g} {exposure.set_unit}"
        return ""

    def view(self, name: str) -> PlanView:
        """Return a view by its name; an `InputError` says which there are."""
        views = {view.name: view for view in self.views}
        if name in views:
            return views[name]
        msg = f"the plan has no view {name!r}{did_you_mean(name, views)}"
        raise InputError(msg)

    # -- figures --------------------------------------------------------------------------------

    @property
    def n_captures(self) -> int:
        """Number of captures."""
        return sum(len(view.exposures) for view in self.views)

    @property
    def time_ms(self) -> float:
        """What captures and moves take, ms."""
        captures = sum(
            self.costs.capture_ms(each.exposure_ms)
            for view in self.views
            for each in view.exposures
        )
        return captures + self.costs.move_ms * len(self.views)

    def with_status(self, status: str) -> tuple[FeatureOutlook, ...]:
        """Return the features that are "planned", "best effort" or "not planned"."""
        return tuple(each for each in self.features if each.status == status)

    @property
    def verdict(self) -> str:
        """The answer in a sentence."""
        planned, n = len(self.with_status("planned")), len(self.features)
        if not self.views:
            why = next((f"; {each.feature}: {each.reason}" for each in self.features), "")
            return f"take none: no capture serves any of {counted(n, 'feature')}{why}"
        return (
            f"take {counted(self.n_captures, 'capture')} in {counted(len(self.views), 'view')}: "
            f"{planned} of {counted(n, 'feature')} will reach {self.target_p_norm:g} with a chance "
            f"of {100 * self.confidence:.4g} % or more"
        )

    @property
    def proof(self) -> str:
        """How good the plan is beside all others, in a phrase."""
        proof = self.certificate
        bound = number(proof.bound, 4)
        if proof.unit == "features":
            return "no plan serves more" if proof.proven else f"at most {bound} features can be had"
        least = "fewest" if proof.unit == "captures" else "quickest"
        if self.expected_misses is not None:
            each = f"each feature at {100 * self.confidence:.4g} %"
            if not proof.proven:
                each = f"at least {bound} {proof.unit} are needed for {each}"
            less = "fewer captures" if proof.unit == "captures" else "less time"
            return (
                f"{f'proven {least} for {each}' if proof.proven else each}; for "
                f"{self.expected_misses:g} expected misses {less} may be enough"
            )
        if proof.proven:
            return f"proven {least}"
        return f"at least {bound} {proof.unit} are needed (gap {100 * proof.gap:.1f} %)"

    @property
    def misses(self) -> float:
        """How many of all features are to be expected to fail, those not planned among them."""
        return float(sum(1.0 - each.chance for each in self.features))

    @property
    def notes(self) -> tuple[str, ...]:
        """Why features that are tried may fail, a wish that is not kept, and remarks."""
        wish = self.expected_misses
        broken = (
            ()
            if wish is None or self.misses <= wish + _CLOSE
            else (
                f"not kept: {wish:g} expected misses were asked for, {number(self.misses, 3)} are "
                f"to be expected of all {counted(len(self.features), 'feature')}",
            )
        )
        return (*broken, *failures(self.features), *self.remarks)

    @property
    def frame(self) -> pl.DataFrame:
        """A row for each feature: columns as in `FeatureOutlook`, the window's ends apart."""
        return outlook_frame(self.features)

    @property
    def table(self) -> Table:
        """The features, those that fail first."""
        return outlook_table(self.features)

    @property
    def view_table(self) -> Table:
        """The views, in the order in which they are visited."""
        served = {view.name: 0 for view in self.views}
        for each in self.features:
            if each.view is not None:
                served[each.view] += 1
        rows = [
            {
                "view": view.name,
                "captures": len(view.exposures),
                "exposures_ms": [each.exposure_ms for each in view.exposures],
                "set_to": ", ".join(f"{each.set_value:.8g}" for each in view.exposures)
                + f" {self.limits.unit}",
                "features": served[view.name],
            }
            for view in self.views
        ]
        if not rows:
            return Table(name="views", frame=pl.DataFrame(), columns=(), shown_rows=0)
        return Table.of("views", rows, _VIEW_COLUMNS)

    def __str__(self) -> str:
        return "\n".join((self.verdict, str(self.view_table), str(self.table), *self.notes))

    def _repr_html_(self) -> str:
        tables = self.view_table._repr_html_() + self.table._repr_html_() if self.views else ""
        return f"<p>{self.verdict}; {self.proof}</p>{tables}"

    # -- other forms ----------------------------------------------------------------------------

    def measuring_plan(self, sensor: ActiveSensor, *, name: str = "exposures") -> MeasuringPlan:
        """Return the measuring plan of these views and exposure times.

        Parameters
        ----------
        sensor : ActiveSensor
            The sensor that measures.
        name : str
            Of the measuring plan.

        Raises
        ------
        InputError
            If there is no capture, or a view's pose is not known.
        SensorError
            If it is another sensor than the one that was planned for.
        """
        if sensor.name != self.sensor:
            msg = f"the plan is for sensor {self.sensor!r}, got {sensor.name!r}; plan for that one"
            raise SensorError(msg)
        poses = {view.name: view.camera_from_part for view in self.views}
        unknown = [view for view, pose in poses.items() if pose is None]
        if unknown or not poses:
            got = f"the poses of {', '.join(unknown)} are not known" if unknown else "it has none"
            msg = f"a measuring plan needs views with poses: {got}; plan with views of a plan"
            raise InputError(msg)
        rows = tuple(tuple(pose.to_matrix().ravel().tolist()) for pose in poses.values() if pose)
        views = PoseList(
            name="planned",
            notation="matrix",
            frame="camera_from_part",
            rows=rows,
            names=tuple(poses),
            exposures_each_ms=tuple(
                tuple(sorted(each.exposure_ms for each in view.exposures)) for view in self.views
            ),
        )
        features = tuple(each.feature for each in self.features)
        return MeasuringPlan(name=name, sensor=sensor, features=features, poses=(views,))

    def to_json(self) -> str:
        """Return the plan as a JSON document (``docs/formats.md``)."""
        return _FORMAT.to_json(self)

    def write(self, path: str | Path) -> None:
        """Write the plan's JSON file, for `read_exposure_plan`; it is whole or absent.

        Raises
        ------
        FileError
            If the disk refuses.
        """
        write_exposure_plan(path, self)


_FORMAT = DocumentFormat("exposight plan", 1, ExposurePlan)


def parse_exposure_plan(text: str, source: str) -> ExposurePlan:
    """Read an exposure plan from a JSON document, called `source` in messages.

    Raises
    ------
    FormatError
        If it is not such a document, a key is missing or unknown, or values contradict each other.
    VersionError
        If a newer version of exposight wrote it.
    """
    return _FORMAT.from_json(text, source)


def read_exposure_plan(path: str | Path) -> ExposurePlan:
    """Read an exposure plan's JSON file.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError, VersionError
        As `parse_exposure_plan`.
    """
    return parse_exposure_plan(read_text(Path(path), "exposure plan"), str(path))


def write_exposure_plan(path: str | Path, plan: ExposurePlan) -> None:
    """Write an exposure plan's JSON file; the file is whole or absent.

    Raises
    ------
    FileError
        If the disk refuses.
    """
    write_durably(Path(path), plan.to_json().encode())

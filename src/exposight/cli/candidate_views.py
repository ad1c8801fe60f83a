"""Views that could be captured, as commands are told them: by a plan, a campaign or a table."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import polars as pl

from exposight.cell import ActiveSensor, Part, read_features
from exposight.cli.app import UsageError
from exposight.cli.measure import plan_from
from exposight.errors import FeatureError, InputError
from exposight.files import spelled
from exposight.geometry import RigidTransform
from exposight.measuring.record import PLAN_FILE
from exposight.observing import View, Visibility, open_campaign, read_observations
from exposight.plans import PLANS, MeasuringPlan, PoseList, read_plan
from exposight.tables import counted
from exposight.twin import SimulatedCellSettings, scene_at

_EXPOSURES = 40
"""Exposure times between two, unless they are given one by one."""

_TABLES = {".csv", ".parquet"}


@dataclass(frozen=True, kw_only=True)
class CandidateViews:
    """Rings of views, and where the views are if that is known.

    Parameters
    ----------
    source : str
        What names them on the command line.
    frame : polars.DataFrame
        Their rings (`View.frame`).
    sensor : ActiveSensor, optional
        Which looks at them.
    poses : mapping of str to (str, RigidTransform)
        Group and camera_from_part of each view.
    plan : MeasuringPlan, optional
        That they belong to.
    hidden : mapping of str to str
        Features that no view sees, and why, where that is known.
    """

    source: str
    frame: pl.DataFrame
    sensor: ActiveSensor | None = None
    poses: Mapping[str, tuple[str, RigidTransform]] = field(default_factory=dict)
    plan: MeasuringPlan | None = None
    hidden: Mapping[str, str] = field(default_factory=dict)

    def without(self, views: Iterable[str]) -> "CandidateViews":
        """Leave views out.

        Raises
        ------
        InputError
            If none is left.
        """
        left = self.frame.filter(~pl.col("view").is_in(list(views)))
        if left.height == 0:
            n_views = self.frame["view"].n_unique()
            msg = (
                f"nothing is left to propose: {counted(n_views, 'view')} of {self.source} "
                f"{'is' if n_views == 1 else 'are all'} captured; give other --views, or --again "
                "to capture some once more"
            )
            raise InputError(msg)
        return replace(self, frame=left)

    def plan_of(self, captures: pl.DataFrame) -> MeasuringPlan:
        """Return the plan of some captures, groups and their settings as before."""
        times_ms: dict[str, list[float]] = {}
        for view, exposure_ms in captures.select("view", "exposure_ms").iter_rows():
            times_ms.setdefault(view, []).append(exposure_ms)
        groups: dict[str, list[str]] = {}
        for view in times_ms:
            groups.setdefault(self.poses[view][0], []).append(view)
        poses = tuple(
            PoseList(
                name=group,
                notation="matrix",
                frame="camera_from_part",
                rows=tuple(tuple(self.poses[v][1].to_matrix().ravel().tolist()) for v in views),
                names=tuple(views),
                exposures_each_ms=tuple(tuple(sorted(set(times_ms[v]))) for v in views),
            )
            for group, views in groups.items()
        )
        if self.plan is not None:
            name = f"{self.plan.name}, next"
            return replace(self.plan, name=name, planes=(), random=(), poses=poses)
        assert self.sensor is not None  # whoever knows poses knows it
        features = tuple(self.frame["feature"].unique(maintain_order=True))
        name = f"{Path(self.source).name}, next"
        return MeasuringPlan(name=name, sensor=self.sensor, features=features, poses=poses)


def is_plan(source: str) -> bool:
    """Return whether a name is meant as a measuring plan's, not a campaign's or a table's."""
    path = Path(source)
    return source in PLANS or not (path.suffix.lower() in _TABLES or path.is_dir())


def candidate_views(source: str, features: Path | None) -> CandidateViews:
    """Return the views of a plan, a campaign or a table.

    Parameters
    ----------
    source : str
        Name of a plan, or path of any of them.
    features : Path, optional
        The part's features, in place of those of a plan's scene.

    Raises
    ------
    ExposightError
        If it is none of them, cannot be read, or no view sees a feature.
    """
    if is_plan(source):
        candidates = _of_plan(source, features)
    elif Path(source).is_dir():
        candidates = _of_campaign(Path(source))
    else:
        candidates = _of_table(Path(source))
    if candidates.frame.height == 0:
        msg = f"{source}: no view sees a feature; check poses, and on which side features are"
        raise InputError(msg)
    return candidates


def _of_table(path: Path) -> CandidateViews:
    frame = read_observations(path).frame
    seen = frame.filter(pl.col("visibility") == Visibility.VISIBLE.value)
    rings = seen.unique(["feature", "view"], keep="first", maintain_order=True)
    return CandidateViews(source=str(path), frame=rings)


def _of_campaign(path: Path) -> CandidateViews:
    """Return the views that a campaign has captures of, and those that its plan has yet."""
    campaign = open_campaign(path)
    captured = {each.view: each.camera_from_part for each in campaign.descriptions()}
    plan_file, part = path / PLAN_FILE, campaign.part
    plan = read_plan(plan_file) if plan_file.is_file() else None
    planned = {} if plan is None else {view.name: view for view in plan.views(part)}
    places = {name: view.camera_from_part for name, view in planned.items()} | captured
    if plan is not None:
        part = plan.observed_part(part)
    poses = {
        name: (planned[name].group, planned[name].camera_from_part)
        if name in planned
        else (name, pose)
        for name, pose in places.items()
    }
    rings, hidden = _rings(part, campaign.sensor, places)
    return CandidateViews(
        source=str(path),
        frame=rings,
        sensor=campaign.sensor,
        poses=poses,
        plan=plan,
        hidden=hidden,
    )


def _of_plan(source: str, features: Path | None) -> CandidateViews:
    plan = plan_from(source)
    folder = None if source in PLANS else Path(source).parent
    simulated = dict(plan.simulated)
    if features is not None:
        part = Part(name=spelled(features.stem), features=read_features(features))
    else:
        settings = SimulatedCellSettings.of_plan(plan, folder)
        part = scene_at(settings.scene, settings.finishes).part_with_finishes()
        if settings.scene is not None:
            simulated["scene"] = str(settings.scene.resolve())  # a next plan may lie elsewhere
    try:
        views = plan.views(part)
    except FeatureError as error:
        if features is not None:
            raise
        msg = f"{error}; give the list of the part's features by --features"
        raise FeatureError(msg) from error
    places = {view.name: view.camera_from_part for view in views}
    rings, hidden = _rings(plan.observed_part(part), plan.sensor, places)
    if features is not None:  # such a file does not tell the part's name, by which models know it
        rings = rings.with_columns(part=pl.lit(None, pl.String))
    return CandidateViews(
        source=source,
        frame=rings,
        sensor=plan.sensor,
        poses={view.name: (view.group, view.camera_from_part) for view in views},
        plan=replace(plan, simulated=simulated),
        hidden=hidden,
    )


def _rings(
    part: Part, sensor: ActiveSensor, places: Mapping[str, RigidTransform]
) -> tuple[pl.DataFrame, dict[str, str]]:
    """Return the rings that views see, and which features none sees, with what is in the way."""
    views = [View.of(part, sensor, pose, name=name) for name, pose in places.items()]
    frames = [view.frame for view in views]
    rings = pl.concat(frames, how="diagonal_relaxed") if frames else pl.DataFrame()
    visible = {each.feature.name for view in views for each in view.visible}
    reasons: dict[str, Counter[str]] = {}
    for view in views:
        for each in view.features:
            if each.feature.name not in visible:
                counts = reasons.setdefault(each.feature.name, Counter())
                counts[each.visibility.value] += 1
    return rings, {name: counts.most_common(1)[0][0] for name, counts in reasons.items()}


def settable_exposures(given: Sequence[str], sensor: ActiveSensor | None) -> tuple[float, ...]:
    """Return exposure times that a sensor can be set to, ms.

    Parameters
    ----------
    given : sequence of str
        ``FIRST:LAST``, or times one by one; the sensor's range if empty.
    sensor : ActiveSensor or None
        None where it is not known, and any time can be set.

    Raises
    ------
    UsageError
        If they are no times, or there is neither one nor a sensor.
    SensorError
        If the sensor cannot take one.
    """
    wishes: list[float]
    try:
        if len(given) == 1 and ":" in given[0]:
            first, last = map(float, given[0].split(":"))
            if not 0.0 < first < last:
                raise ValueError
            wishes = np.clip(np.geomspace(first, last, _EXPOSURES), first, last).tolist()
        elif given:
            wishes = [float(each) for each in given]
        elif sensor is None:
            msg = "the model names no sensor: give exposure times by --exposures FIRST:LAST"
            raise UsageError(msg)
        else:
            least, most = sensor.exposure.min_ms, sensor.exposure.max_ms
            wishes = np.clip(np.geomspace(least, most, _EXPOSURES), least, most).tolist()
    except ValueError:
        msg = (
            "--exposures takes FIRST:LAST, as 5:500, or times one by one, in ms; got "
            f"{' '.join(given)}"
        )
        raise UsageError(msg) from None
    if sensor is not None:
        wishes = [sensor.nearest_exposure(each) for each in wishes]
    return tuple(sorted(set(wishes)))

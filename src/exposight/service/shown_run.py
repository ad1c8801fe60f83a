"""What the live page shows of a run, computed from its plan, its captures and its models.

Everything is read from disk as it is now: a run grows while it is looked at, and any server process
may be asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from exposight.cell import CampaignFolder, Part
from exposight.cell.capture import CaptureDescription
from exposight.errors import ExposightError, InputError, MissingFileError, did_you_mean
from exposight.geometry import RigidTransform
from exposight.measuring.decisions import HAD, OPEN
from exposight.measuring.view_work import OBSERVATIONS_FILE
from exposight.models import P_NORM_MIN
from exposight.observing import ObservationTable, View, parse_observations
from exposight.planning import ExposurePlan, FeatureOutlook, Forecast, SensorModels

FAILED, UNSEEN = "failed", "unseen"
"""Of a feature, beside `HAD` and `OPEN`: it cannot be had, or no view of the plan sees it."""

_STATUS = {HAD: HAD, OPEN: OPEN, "given up": FAILED, "not seen": UNSEEN}
_NO_OUTLOOK = FeatureOutlook(feature="", status="not planned", chance=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownRun:
    """A run as it stands.

    Parameters
    ----------
    features : tuple of str
        What is to be measured.
    campaign : CampaignFolder or None
        Its captures; None before the first.
    plan : ExposurePlan or None
        What was promised; None of a measuring plan, which promises nothing.
    models : SensorModels or None
        That decide.
    outcomes : mapping of str to mapping
        What has become of features so far, fields of `Outcome` by feature.
    ended : bool
        Whether nothing more will come.
    """

    features: tuple[str, ...]
    campaign: CampaignFolder | None = None
    plan: ExposurePlan | None = None
    models: SensorModels | None = None
    outcomes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    ended: bool = False

    @property
    def need(self) -> float:
        """p_norm that is asked for."""
        return P_NORM_MIN if self.plan is None else self.plan.target_p_norm

    @property
    def part(self) -> Part | None:
        """What is measured, once its captures tell."""
        return None if self.campaign is None else self.campaign.part

    def captures(self) -> list[tuple[int, CaptureDescription]]:
        """Return the captures that are there, by number."""
        if self.campaign is None:
            return []
        return list(zip(self.campaign.numbers, self.campaign.descriptions(), strict=True))

    def observations(self, numbers: Sequence[int]) -> ObservationTable | None:
        """Return the rows that lie beside captures; None where none does."""
        if self.campaign is None:
            return None
        tables = [_stored_rows(self.campaign.path, number) for number in numbers]
        known = [each for each in tables if each is not None]
        return ObservationTable.concat(known) if known else None

    # -- the part -------------------------------------------------------------------------------

    def scene(self, surface: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the features with what is known of each, the views, and the part's surface.

        Parameters
        ----------
        surface : mapping, optional
            Vertices and triangles (`coarse_surface`).
        """
        captures = self.captures()
        table = self.observations([number for number, _ in captures])
        best = {} if table is None else _best_rows(table)
        plan = {} if self.plan is None else {each.feature: each for each in self.plan.features}
        return {
            "part": self.part.name if self.part else self.plan.part if self.plan else "",
            "need": self.need,
            "features": [
                self._shown_feature(name, plan.get(name, _NO_OUTLOOK), best.get(name))
                for name in self.features
            ],
            "views": self._shown_views(captures),
            "mesh": surface,
        }

    def _shown_feature(
        self, name: str, outlook: FeatureOutlook, best: Mapping[str, Any] | None
    ) -> dict[str, Any]:
        """Return where a feature is, how it stands and what is known of its quality."""
        outcome = self.outcomes.get(name, {})
        p_norm = None if best is None else float(best["p_norm"])
        status = _STATUS.get(outcome.get("status", ""), OPEN)
        if p_norm is not None and p_norm >= self.need:
            status = HAD  # captures are on disk before anything is said of them
        elif self.ended and status == OPEN and (self.plan is not None or p_norm is not None):
            status = FAILED
        reason = "" if status == HAD else outcome.get("reason", "") or outlook.reason
        return {
            "name": name,
            **_placed(self.part, name),
            "status": status,
            "p_norm": rounded(p_norm),
            "exposure_ms": None if best is None else best["exposure_ms"],
            "predicted": rounded(outlook.chance) if outlook.view is not None else None,
            "view": outlook.view if best is None else best["view"],
            "reason": reason,
        }

    def _shown_views(self, captures: Sequence[tuple[int, CaptureDescription]]) -> list[Any]:
        """Return the views with planned exposure times and the captures that were taken."""
        planned = {} if self.plan is None else {view.name: view for view in self.plan.views}
        poses = {name: view.camera_from_part for name, view in planned.items()}
        taken: dict[str, list[dict[str, Any]]] = {name: [] for name in planned}
        for number, each in captures:
            poses.setdefault(each.view, each.camera_from_part)
            row = {"number": number, "exposure_ms": each.exposure_ms}
            taken.setdefault(each.view, []).append(row)
        return [
            {
                "name": name,
                **_standing(poses[name]),
                "planned_ms": [each.exposure_ms for each in planned[name].exposures]
                if name in planned
                else [],
                "captures": rows,
                "done": bool(rows),
            }
            for name, rows in taken.items()
        ]

    # -- one feature ----------------------------------------------------------------------------

    def curve(self, feature: str, view: str | None = None) -> dict[str, Any]:
        """Return a feature's quality over exposure time: forecast, chosen times, measured points.

        Parameters
        ----------
        feature : str
        view : str, optional
            By default the one that measured it best, else the one in which it is planned.

        Raises
        ------
        MissingFileError
            If the run has no such feature, or no such view.
        """
        if feature not in self.features:
            msg = f"the run has no feature {feature!r}{did_you_mean(feature, self.features)}"
            raise MissingFileError(msg)
        captures = self.captures()
        rows = self.observations([number for number, _ in captures])
        rows = None if rows is None else rows.measured()
        views = self._views_of(feature, rows)
        name = view or next(iter(views), None)
        planned = {} if self.plan is None else {each.name: each for each in self.plan.views}
        known = {**planned, **dict.fromkeys(each.view for _, each in captures)}
        if name is not None and name not in known:
            msg = f"the run has no view {name!r}{did_you_mean(name, known)}"
            raise MissingFileError(msg)
        pose = next((each.camera_from_part for _, each in captures if each.view == name), None)
        if pose is None and name in planned:
            pose = planned[name].camera_from_part
        of_view = None if rows is None else rows.where((rows.frame["view"] == name).to_numpy())
        return {
            "feature": feature,
            "view": name,
            "views": views,
            "need": self.need,
            "limits": self._limits(),
            "chosen_ms": [each.exposure_ms for each in planned[name].exposures]
            if name in planned
            else [],
            "measured": [] if of_view is None else _points(of_view, feature),
            **self._forecast(feature, name, pose, of_view),
        }

    def _views_of(self, feature: str, rows: ObservationTable | None) -> list[str]:
        """Return the views of a feature: the one that measured it best first, else the planned."""
        planned = () if self.plan is None else self.plan.features
        names = [each.view for each in planned if each.feature == feature and each.view is not None]
        if rows is None:
            return names
        frame = rows.frame.filter(pl.col("feature") == feature)
        best = frame.group_by("view", maintain_order=True).agg(pl.col("p_norm").max())
        known = dict(best.iter_rows())
        names = list(dict.fromkeys([*names, *known]))
        return sorted(names, key=lambda name: -known.get(name, -1.0))

    def _limits(self) -> dict[str, Any] | None:
        """Return what the sensor can be set to."""
        if self.plan is not None:
            limits = self.plan.limits
            return {"min_ms": limits.min_ms, "max_ms": limits.max_ms, "unit": limits.unit}
        if self.campaign is None:
            return None
        possible = self.campaign.sensor.exposure
        return {"min_ms": possible.min_ms, "max_ms": possible.max_ms, "unit": "ms"}

    def _forecast(
        self,
        feature: str,
        view: str | None,
        pose: RigidTransform | None,
        rows: ObservationTable | None,
    ) -> dict[str, Any]:
        """Return what models expect: from the pose, and as captures of the view have corrected it.

        No arrays where there are no models, or the view does not see the feature.
        """
        nothing: dict[str, Any] = {
            "exposure_ms": [], "p_norm": [], "low": [], "high": [], "before": [], "corrected": False
        }  # fmt: skip
        if self.models is None or self.part is None or pose is None or self.campaign is None:
            return nothing
        seen = View.of(self.part, self.campaign.sensor, pose, name=view or "")
        if feature not in {each.feature.name for each in seen.visible}:
            return nothing
        before = self.models.forecast(seen, need=self.need, correct=True)
        after = _corrected(self.models, seen, before, rows, self.need)
        i = before.features.index(feature)
        return {
            "exposure_ms": list(before.exposures_ms),
            "p_norm": listed(after.p_norm[i]),
            "low": listed(after.p_norm_low[i]),
            "high": listed(after.p_norm_high[i]),
            "before": listed(before.p_norm[i]),
            "corrected": after is not before,
        }


def _corrected(
    models: SensorModels, seen: View, before: Forecast, rows: ObservationTable | None, need: float
) -> Forecast:
    """Return a forecast as captures of its view correct it, where the models can learn of them."""
    if rows is None or len(rows) == 0:
        return before
    try:
        return models.forecast(seen, before.exposures_ms, trial=rows, need=need, correct=True)
    except ExposightError:  # of models that cannot learn from captures the pose's forecast stands
        return before


def feature_names(plan: Any) -> tuple[str, ...]:
    """Return the features of an exposure plan or a measuring plan."""
    if isinstance(plan, ExposurePlan):
        return tuple(each.feature for each in plan.features)
    return tuple(plan.features)


def listed(values: NDArray[np.float64]) -> list[float | None]:
    """Return numbers as JSON has them, to four decimals."""
    return [rounded(float(each)) for each in values]


def rounded(value: float | None) -> float | None:
    """Return a number to four decimals; None where it is none."""
    return None if value is None or not np.isfinite(value) else round(value, 4)


def _placed(part: Part | None, name: str) -> dict[str, Any]:
    """Return where a feature is on the part, and which way it faces."""
    feature = None if part is None else next((e for e in part.features if e.name == name), None)
    if feature is None:
        return {"kind": None, "position_mm": None, "normal": None, "radius_mm": None}
    pose = feature.part_from_feature
    return {
        "kind": feature.kind,
        "position_mm": np.round(pose.translation_mm, 3).tolist(),
        "normal": np.round(-pose.rotation[:, 2], 5).tolist(),  # z looks into the material
        "radius_mm": feature.radius_mm,
    }


def _standing(camera_from_part: RigidTransform | None) -> dict[str, Any]:
    """Return where the camera stands in the part's frame, and where it looks."""
    if camera_from_part is None:
        return {"camera_position_mm": None, "axis": None, "up": None}
    part_from_camera = camera_from_part.inverse()
    return {
        "camera_position_mm": np.round(part_from_camera.translation_mm, 2).tolist(),
        "axis": np.round(part_from_camera.rotation[:, 2], 5).tolist(),
        "up": np.round(-part_from_camera.rotation[:, 1], 5).tolist(),
    }


def _best_rows(table: ObservationTable) -> dict[str, dict[str, Any]]:
    frame = table.measured().frame.select("feature", "p_norm", "view", "exposure_ms")
    frame = frame.sort("p_norm", descending=True).unique("feature", keep="first")
    return {row["feature"]: row for row in frame.iter_rows(named=True)}


def _points(rows: ObservationTable, feature: str) -> list[dict[str, Any]]:
    frame = rows.frame.filter(pl.col("feature") == feature).select("exposure_ms", "p_norm")
    return [
        {"exposure_ms": exposure_ms, "p_norm": rounded(p_norm)}
        for exposure_ms, p_norm in frame.iter_rows()
    ]


def _stored_rows(campaign: Path, number: int) -> ObservationTable | None:
    """Return the rows beside a capture, None where there are none; read once."""
    folder = campaign / "captures" / f"{number:06d}"
    try:
        about = folder.stat()
    except OSError as error:
        msg = f"capture {number} of {campaign.name} has gone; look at the run again"
        raise MissingFileError(msg) from error
    return _rows_at(campaign, number, about.st_ino, about.st_mtime_ns)


@lru_cache(maxsize=1024)
def _rows_at(campaign: Path, number: int, *_identity: int) -> ObservationTable | None:
    attachments = CampaignFolder(campaign).attachments(number)
    if OBSERVATIONS_FILE not in attachments:
        return None
    try:
        return parse_observations(attachments[OBSERVATIONS_FILE], f"capture {number}")
    except InputError as error:
        msg = f"capture {number}: {error}"
        raise InputError(msg) from error

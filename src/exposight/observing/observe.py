"""From captures to observations: Sect. 3.1 of the paper to the letter.

n_points counts the cloud's points inside the hollow cylinder (Eq. 4), n_pixels the pixels of its
ring (Eqs. 6, 7) on the cloud's grid, which is the image's or a whole fraction of it (half its rows
and columns, say), p_norm is their ratio (Eq. 5), i_avg the mean grey value of those pixels in the
capture's image, and the pose is that of the feature in the sensor's TCP frame.
"""

import base64
import html
import logging
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from exposight import cell
from exposight.contradictions import Contradiction, clouds, places, rings, settle
from exposight.contradictions.contradiction import check_names
from exposight.errors import CloudError, ContradictionError, InputError, ObservationError
from exposight.geometry import RigidTransform
from exposight.observing import masks
from exposight.observing.brightness import ring_brightness
from exposight.observing.capture_checks import CAPTURE_CHECKS, at_features, capture_contradictions
from exposight.observing.point_search import PointSearch, point_search
from exposight.observing.readings import (
    pose_contradictions,
    pose_with_holes,
    reading_that_fits,
    why_not_visible,
)
from exposight.observing.ring_geometry import ring_geometry
from exposight.observing.schema import Observation
from exposight.observing.table import ObservationTable
from exposight.workers import Progress, ignore_progress

logger = logging.getLogger(__name__)

_NO_COLUMNS: Mapping[str, Any] = MappingProxyType({})


def observe_capture(
    capture: cell.Capture,
    views: tuple[masks.FeatureView, ...],
    search: PointSearch,
    shared: Mapping[str, Any] = _NO_COLUMNS,
) -> list[Observation]:
    """Observe features in one capture.

    Parameters
    ----------
    capture : Capture
        Brings image and exposure time.
    views : tuple of FeatureView
        The features as this capture's view sees them (`view_features`).
    search : PointSearch
        The capture's cloud, made ready for counting (`point_search`).
    shared : mapping of str to object
        Columns that all rows share (`Observer` knows sensor and part).

    Returns
    -------
    list of Observation
        One for each feature, also for those that cannot be measured, in the order given.
    """
    measured = [view for view in views if view.visibility is masks.Visibility.VISIBLE]
    counts = search.count(measured)
    geometry = ring_geometry(measured, search, counts)
    rings = zip(counts.tolist(), search.pixels(measured).tolist(), geometry, strict=True)
    by_view = dict(zip(map(id, measured), rings, strict=True))
    return [_observe(capture, view, by_view.get(id(view)), shared) for view in views]


class Observer:
    """Observes captures of a part one after the other; those of one pose share their masks.

    Parameters
    ----------
    part : Part
        What is observed.
    sensor : ActiveSensor
        What takes the captures.
    tolerance : RingTolerance
        Height and radii of the hollow cylinders.
    despite : collection of str
        Names of checks whose errors are accepted (`exposight.contradictions`).

    Raises
    ------
    InputError
        If a check of that name does not exist.

    Attributes
    ----------
    contradictions : tuple of Contradiction
        What did not agree so far, where the rows may still be right.
    """

    def __init__(
        self,
        part: cell.Part,
        sensor: cell.ActiveSensor,
        tolerance: cell.RingTolerance = cell.PAPER_TOLERANCE,
        *,
        despite: Collection[str] = (),
    ) -> None:
        self._part, self._sensor, self._tolerance = part, sensor, tolerance
        check_names(despite, CAPTURE_CHECKS)
        self._despite = despite
        self.contradictions: tuple[Contradiction, ...] = ()
        self._pose: RigidTransform | None = None
        self._views: tuple[masks.FeatureView, ...] = ()
        self._shared: dict[str, Any] = {}
        self._of_pose: tuple[Contradiction | None, ...] = ()

    def observe(self, capture: cell.Capture) -> list[Observation]:
        """Return an observation of each feature, in the part's order (`observe_capture`).

        Raises
        ------
        ContradictionError
            If what the capture says of itself cannot be true.
        """
        if capture.camera_from_part != self._pose:
            self._pose = capture.camera_from_part
            self._views = masks.view_features(self._part, self._sensor, self._pose, self._tolerance)
            self._shared = masks.shared_columns(self._part, self._sensor, self._pose)
            self._of_pose = tuple(
                pose_contradictions(
                    self._views, self._part, self._sensor, self._pose, name=capture.view
                )
            )
        search = point_search(capture.require_cloud(), self._sensor.camera)
        rows = observe_capture(capture, self._views, search, self._shared)
        found = [each for each in self._of_pose if each is not None] + [
            self._explained(each, capture)
            for each in capture_contradictions(capture, self._sensor, self._views, rows, search)
            if each is not None
        ]
        if found:
            try:
                settled = settle(found, self._despite)
            except ContradictionError as error:
                msg = f"{capture}: {error}"
                raise ContradictionError(msg, error.contradictions) from error
            self.contradictions = tuple(dict.fromkeys((*self.contradictions, *settled)))
        return rows

    def _explained(self, found: Contradiction, capture: cell.Capture) -> Contradiction:
        """Return a contradiction with the reading that explains it, if one does."""
        if found.check == places.NO_HOLE and places.HALVED not in found.explanation:
            words = self._pose_with_holes(capture)
            return replace(found, explanation=words, is_error=True) if words else found
        if found.check not in {clouds.BEHIND, rings.ELSEWHERE}:
            return found
        reading = reading_that_fits(capture, self._part, self._sensor, self._tolerance)
        if reading is None:
            return found
        return replace(found, explanation=str(reading), is_error=True)

    def _pose_with_holes(self, capture: cell.Capture) -> str:
        """Return the reading of the pose that puts holes where holes are said to be, or ''."""
        search = point_search(capture.require_cloud(), self._sensor.camera)

        def observed(
            views: tuple[masks.FeatureView, ...],
        ) -> tuple[list[float], list[float]]:
            rows = observe_capture(capture, views, search)
            filled, *_ = at_features(views, rows, search, sees_holes=True)
            return [row.p_norm for row in rows if row.p_norm is not None], filled

        pose = capture.camera_from_part
        return pose_with_holes(self._part, self._sensor, pose, self._tolerance, observed)


_ROWS_AT_ONCE = 2000
"""Rows that are Python objects, of 2 kB each, at the same time; the others are columns."""


def observe_campaign(
    campaign: cell.CaptureSource,
    tolerance: cell.RingTolerance = cell.PAPER_TOLERANCE,
    progress: Progress = ignore_progress,
    *,
    despite: Collection[str] = (),
) -> ObservationTable:
    """Observe every feature in every capture of a campaign, one capture in memory at a time.

    Parameters
    ----------
    campaign : CaptureSource
        Recorded or simulated.
    tolerance : RingTolerance
        Height and radii of the hollow cylinder; the paper's by default.
    progress : Progress
        Receives the captures that are observed.
    despite : collection of str
        Names of checks whose errors are accepted (`exposight.contradictions`).

    Returns
    -------
    ObservationTable
        Its ``contradictions`` are those under which it may still be right.

    Raises
    ------
    CloudError
        If a capture was kept without its cloud, or no cloud has a valid point. (One dark or
        clipped capture without any point is an observation like others: its p_norm is 0.)
    ObservationError
        If no feature could be measured in any capture.
    ContradictionError
        If the inputs contradict themselves: clouds in metres or with turned axes, another camera's
        image, a pose that is the inverse one, a cloud thinner than the image …
    """
    rows: list[Observation] = []
    tables: list[ObservationTable] = []
    observer = Observer(campaign.part, campaign.sensor, tolerance, despite=despite)
    some: cell.Capture | None = None
    for done, capture in enumerate(campaign.captures(), start=1):
        cloud = capture.require_cloud()
        if some is None and cloud.n_valid:
            some = capture
        rows.extend(observer.observe(capture))
        if len(rows) >= _ROWS_AT_ONCE:
            tables.append(ObservationTable.from_observations(rows))
            rows = []
        progress("observing", done, len(campaign))
    table = ObservationTable.concat([*tables, ObservationTable.from_observations(rows)])
    if len(table) and some is None:
        msg = (
            f"campaign '{campaign.name}': none of its {len(campaign)} clouds has a valid point "
            "(NaN and all-zero points are missing ones); expected clouds in mm in the camera's "
            "frame, check how they were exported"
        )
        raise CloudError(msg)
    logger.info("observed %d captures, %d rows", len(campaign), len(table))
    found = () if some is None else _measured_somewhere(table, some, campaign, tolerance)
    settled = settle((*observer.contradictions, *found), despite)
    return replace(table, contradictions=settled)


_DARK, _BRIGHT = 15.0, 235.0
"""Grey levels between which any sensor gives points on some surface."""


def _measured_somewhere(
    table: ObservationTable,
    capture: cell.Capture,
    campaign: cell.CaptureSource,
    tolerance: cell.RingTolerance,
) -> tuple[Contradiction, ...]:
    """Check that features were measured, and that points lie round some of them."""
    measured = table.measured()
    part, sensor = campaign.part, campaign.sensor
    if len(measured) == 0:
        counts = ", ".join(f"{rows} {reason}" for reason, rows in table.counts().items())
        hint = why_not_visible(part, sensor, capture.camera_from_part)
        msg = (
            f"nothing was measured: no feature is visible in any capture ({counts}); "
            f"{hint or 'check the pose, camera_from_part in mm, and the features'}"
        )
        raise ObservationError(msg)
    if (measured.array(["p_norm"]) > 0.0).any():
        return ()
    reading = reading_that_fits(capture, part, sensor, tolerance)
    lit = measured.frame["i_avg"].is_between(_DARK, _BRIGHT).any()
    return (
        Contradiction(
            check=rings.ELSEWHERE,
            compared="the clouds' points against the features' places",
            found="every p_norm is 0: no point of any cloud lies near any feature"
            + (", though the images are lit" if lit else ""),
            explanation=str(reading)
            if reading is not None
            else "check that features and clouds are in mm, the clouds in the camera's frame, and "
            "that the pose is that of the part seen from the camera",
            is_error=reading is not None,
        ),
    )


def _observe(
    capture: cell.Capture,
    view: masks.FeatureView,
    ring: tuple[int, int, Mapping[str, float | None]] | None,
    shared: Mapping[str, Any],
) -> Observation:
    """Make a row of a ring's points, pixels and geometry; None where it cannot be measured."""
    columns: dict[str, Any] = {"p_norm": None, "i_avg": None}
    visibility = view.visibility
    if ring is not None and ring[1] == 0:  # on a grid coarser than the image
        visibility = masks.Visibility.BELOW_ONE_PIXEL
    elif ring is not None:
        n_points, n_pixels, geometry = ring
        columns = {
            "p_norm": n_points / n_pixels,
            "n_points": n_points,
            "n_pixels": n_pixels,
            **ring_brightness(capture, view.rows, view.columns),
            **geometry,
        }
    return Observation(
        feature=view.feature.name,
        view=capture.view,
        exposure_ms=capture.exposure_ms,
        visibility=visibility.value,
        emulated=capture.emulated,
        brightness_source=capture.brightness_source,
        finish=view.feature.finish or None,
        kind=view.feature.kind,
        **view.pose,
        **columns,
        **shared,
    )


_PREVIEW_PX = 320
"""Width of the image that a notebook shows, at most."""


class Campaign(cell.CampaignFolder):
    """A campaign's folder as scripts and notebooks use it: open, look, observe."""

    def observe(
        self,
        *,
        tolerance: cell.RingTolerance = cell.PAPER_TOLERANCE,
        progress: Progress = ignore_progress,
        despite: Collection[str] = (),
    ) -> ObservationTable:
        """Observe every feature in every capture (`observe_campaign`)."""
        return observe_campaign(self, tolerance, progress, despite=despite)

    def view(self, camera_from_part: RigidTransform, name: str = "") -> masks.View:
        """Return what the sensor sees of the part from a pose, measured or not.

        Raises
        ------
        InputError
            If it is no pose.
        """
        if not isinstance(camera_from_part, RigidTransform):
            msg = (
                f"expected a pose, camera_from_part as a RigidTransform, got {camera_from_part!r}; "
                "captures have theirs: capture.camera_from_part"
            )
            raise InputError(msg)
        return masks.View.of(self.part, self.sensor, camera_from_part, name=name)

    def _repr_html_(self) -> str:
        facts = (
            f"<b>{html.escape(self.name)}</b>: {len(self)} captures of "
            f"{html.escape(self.part.name)} ({len(self.part.features)} features) by "
            f"{html.escape(self.sensor.name)}"
        )
        first = next(iter(self.captures()), None)
        if first is None:
            return f"<p>{facts}</p>"
        step = max(1, -(-first.image.shape[1] // _PREVIEW_PX))
        small = np.ascontiguousarray(first.grey_levels()[::step, ::step]).round().astype(np.uint8)
        data = base64.b64encode(cell.png_bytes(small)).decode()
        shown = html.escape(str(first))
        return f'<p>{facts}</p><img alt="{shown}" src="data:image/png;base64,{data}"><p>{shown}</p>'


def open_campaign(path: str | Path) -> Campaign:
    """Open a campaign's folder.

    Raises
    ------
    MissingFileError
        If the folder or one of its files is not there.
    DamagedFileError, FormatError, VersionError
        If it is no campaign, is damaged, or was written by a newer version of exposight.
    """
    return Campaign(Path(path))

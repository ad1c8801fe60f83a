"""A folder of images and clouds, as scanners write them, becomes a campaign."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from exposight import cell
from exposight.contradictions import Contradiction, rings, settle
from exposight.errors import ContradictionError, ExposightError, InputError, PoseError
from exposight.geometry import RigidTransform
from exposight.imaging import CaptureForm
from exposight.measuring.capture_table import CaptureTable
from exposight.measuring.recorded_views import match_views, timed_recordings
from exposight.models.training_needs import TrainingNeeds, training_needs
from exposight.observing import (
    Observation,
    ObservationTable,
    Observer,
    pose_that_fits,
    reading_that_fits,
)
from exposight.workers import Progress, ignore_progress

_SOURCE = "source.json"


@dataclass(frozen=True, kw_only=True)
class Collected:
    """What became of a folder.

    Parameters
    ----------
    taken : tuple of CaptureKey
        Captures that were added now.
    kept : tuple of CaptureKey
        Captures that were there before.
    left_out : mapping of str to str
        Files of which no capture came, and why.
    remarks : tuple of str
        What was recognised.
    contradictions : tuple of Contradiction
        What does not agree and may still be right.
    needs : TrainingNeeds
        What the models would need further.
    """

    taken: tuple[cell.CaptureKey, ...]
    kept: tuple[cell.CaptureKey, ...]
    left_out: Mapping[str, str]
    remarks: tuple[str, ...]
    contradictions: tuple[Contradiction, ...]
    needs: TrainingNeeds


@dataclass(frozen=True, kw_only=True)
class CollectSettings:
    """What is collected, and what its files do not tell.

    Parameters
    ----------
    sensor : ActiveSensor
    part : Part
    poses : mapping of str to RigidTransform
        camera_from_part of each view, by its name; names that differ only in how they write the
        number (P01, P[1]) are the same.
    form : CaptureForm
    table : CaptureTable, optional
        Exposure times, and perhaps poses, of files or views.
    other_poses : callable, optional
        Returns other readings of a pose in `poses`, in words, by its name: those of the chain that
        it comes of. Tried where no point lies near any feature.
    despite : collection of str
        Names of checks whose errors are accepted.
    """

    sensor: cell.ActiveSensor
    part: cell.Part
    poses: Mapping[str, RigidTransform] = field(default_factory=dict)
    form: CaptureForm = field(default_factory=CaptureForm)
    table: CaptureTable | None = None
    other_poses: Callable[[str], Iterable[tuple[str, RigidTransform]]] | None = None
    despite: Collection[str] = ()


def collect(
    recordings: cell.Recordings,
    campaign: str | Path,
    settings: CollectSettings,
    progress: Progress = ignore_progress,
) -> Collected:
    """Add what is in a folder to a campaign, which is made if it is not there.

    What is there already is kept. A file that cannot be read, or contradicts itself, is left out,
    and the others are taken.

    Parameters
    ----------
    recordings : Recordings
        As `exposight.cell.find_recordings` found them.
    campaign : str or Path
        The campaign's folder.
    settings : CollectSettings
    progress : Progress
        Receives the captures that are done.

    Raises
    ------
    InputError
        If views have no pose, or the folder holds a campaign of another sensor or part. All views
        without a pose are named.
    FileError
        If the disk refuses, or another program writes the campaign.
    """
    campaign = Path(campaign)
    poses = {**(settings.table.poses if settings.table else {}), **settings.poses}
    names, remarks = match_views(_views(recordings), poses, recordings.folder)
    left_out = dict(recordings.faults)
    wanted = list(timed_recordings(recordings, settings.table, left_out))
    work = _Work(recordings, settings, names, poses, left_out)
    with cell.CampaignWriter.open_or_create(
        campaign,
        name=campaign.resolve().name,
        sensor=settings.sensor,
        part=settings.part,
    ) as writer:
        work.take(wanted, writer, cell.CampaignFolder(campaign), progress)
    table = ObservationTable.from_observations(work.rows)
    return Collected(
        taken=tuple(work.taken),
        kept=tuple(work.kept),
        left_out=left_out,
        remarks=(*recordings.remarks, *remarks),
        contradictions=work.observer.contradictions,
        needs=training_needs(table),
    )


class _Work:
    """Takes recordings one by one, and those last that too few points tell anything of."""

    def __init__(
        self,
        recordings: cell.Recordings,
        settings: CollectSettings,
        names: Mapping[str, str],
        poses: Mapping[str, RigidTransform],
        left_out: dict[str, str],
    ) -> None:
        self._folder, self._settings = recordings.folder, settings
        self._names, self._poses, self._left_out = names, poses, left_out
        self.observer = Observer(settings.part, settings.sensor, despite=settings.despite)
        self.rows: list[Observation] = []
        self.taken: list[cell.CaptureKey] = []
        self.kept: list[cell.CaptureKey] = []
        self._contradicted = ""
        self._fits = False

    def take(
        self,
        wanted: Sequence[cell.Recording],
        writer: cell.CampaignWriter,
        campaign: cell.CampaignFolder,
        progress: Progress,
    ) -> None:
        """Add recordings to a campaign."""
        known = {key: number for number, key in writer.keys.items()}
        later: list[cell.Recording] = []
        for recording in wanted:
            key = cell.CaptureKey(recording.view, recording.exposure_ms or 0.0)
            if not self._tried(recording, writer, campaign, known.get(key)):
                later.append(recording)
            progress("collecting", len(self.taken) + len(self.kept), len(wanted))
        for recording in later:
            if self._contradicted and not self._fits:
                self._left_out[self._label(recording)] = (
                    f"too few points to tell whether it has what {self._contradicted} has; it was "
                    "left out with that"
                )
            else:
                self._tried(recording, writer, campaign, None, is_last=True)
            progress("collecting", len(self.taken) + len(self.kept), len(wanted))

    def _label(self, recording: cell.Recording) -> str:
        return recording.image.relative_to(self._folder).as_posix()

    def _tried(
        self,
        recording: cell.Recording,
        writer: cell.CampaignWriter,
        campaign: cell.CampaignFolder,
        number: int | None,
        *,
        is_last: bool = False,
    ) -> bool:
        """Return whether a recording was taken, kept or left out; False: it is to be tried last."""
        try:
            if number is not None:
                capture = campaign.capture(number)
                self.rows += self.observer.observe(capture)
                self.kept.append(capture.key)
                _check_unchanged(campaign, number, recording)
                _check_same_pose(capture, self._poses[self._names[recording.view]], campaign)
                return True
            name = self._names[recording.view]
            _check_before_sensor(self._settings.part, self._poses[name])
            capture = _read(recording, self._settings, self._poses[name])
            seen = self.observer.observe(capture)
            fits = any(row.p_norm for row in seen)
            self._fits |= fits
            if not fits and not is_last and capture.require_cloud().n_valid < _ENOUGH_POINTS:
                return False
            _check_somewhere(capture, seen, self._settings, name)
            writer.add(capture)
            self.taken.append(capture.key)
            self.rows += seen
        except ContradictionError as error:
            self._contradicted = self._contradicted or self._label(recording)
            self._left_out[self._label(recording)] = str(error)
        except ExposightError as error:
            self._left_out[self._label(recording)] = str(error)
        return True


def _views(recordings: cell.Recordings) -> tuple[str, ...]:
    return tuple(dict.fromkeys(each.view for each in recordings.found))


def _read(
    recording: cell.Recording, settings: CollectSettings, pose: RigidTransform
) -> cell.Capture:
    if recording.cloud is None:
        msg = (
            f"no cloud beside it: expected one of its name with {', '.join(cell.CLOUD_SUFFIXES)}, "
            "or a depth image of 16 bits with another suffix; named otherwise: --cloud-name, such "
            'as "{view}/depth_{exposure}us"'
        )
        raise InputError(msg)
    form, source = settings.form, _source(recording)
    capture = cell.Capture(
        view=recording.view,
        exposure_ms=recording.exposure_ms or 0.0,
        image=form.image(recording.image),
        cloud=form.cloud(recording.cloud, settings.sensor),
        camera_from_part=pose,
        bit_depth=form.bit_depth,
        brightness_source=form.brightness_source,
        attachments={_SOURCE: json.dumps(source, indent=1).encode()},
    )
    capture.check_fits(settings.sensor)
    if _source(recording) != source:
        msg = "its files changed while they were read; collect it again when they are complete"
        raise InputError(msg)
    return capture


def _check_before_sensor(part: cell.Part, camera_from_part: RigidTransform) -> None:
    """Check that the part is not behind the camera.

    Raises
    ------
    PoseError
        If all of its features are.
    """
    places = camera_from_part.apply([f.part_from_feature.translation_mm for f in part.features])
    if (places[:, 2] <= 0).all():
        msg = (
            f"its pose puts all features behind the sensor, at depths of {places[:, 2].min():.4g} "
            f"to {places[:, 2].max():.4g} mm; expected camera_from_part, in the camera's frame (x "
            "right, y down, z ahead): the part in the camera's frame, or the flange in the base "
            "with --hand-eye and --part-pose"
        )
        raise PoseError(msg)


def _check_same_pose(
    capture: cell.Capture, camera_from_part: RigidTransform, folder: cell.CampaignFolder
) -> None:
    """Check that a capture was collected with the pose that is given now.

    Raises
    ------
    PoseError
        If it was not.
    """
    before, now = capture.camera_from_part.to_matrix(), camera_from_part.to_matrix()
    if not np.allclose(before, now, rtol=0.0, atol=1e-3):
        away = float(np.linalg.norm(before[:3, 3] - now[:3, 3]))
        msg = (
            f"it was collected before with another pose ({away:.3g} mm from the one given now), "
            f"and kept so; collect into a new folder than {folder.path}, or give the pose of then"
        )
        raise PoseError(msg)


_ENOUGH_POINTS = 1000


def _check_somewhere(
    capture: cell.Capture, rows: Sequence[Observation], settings: CollectSettings, name: str
) -> None:
    """Check that points lie near some feature, where another reading puts them there.

    Raises
    ------
    ContradictionError
        If none does, and a reading of the cloud, the pose or the features does; it is named.
    """
    if any(row.p_norm for row in rows) or rings.ELSEWHERE in settings.despite:
        return
    if capture.require_cloud().n_valid < _ENOUGH_POINTS:
        return
    part, sensor = settings.part, settings.sensor
    words = ""
    if settings.other_poses is not None and name in settings.poses:
        words = pose_that_fits(capture, part, sensor, settings.other_poses(name))
    if not words:
        reading = reading_that_fits(capture, part, sensor)
        words = "" if reading is None else str(reading)
    if words:
        found = Contradiction(
            check=rings.ELSEWHERE,
            compared="the cloud's points against the features' places",
            found="no point lies near any feature",
            explanation=words,
        )
        settle([found], settings.despite)


# -- source files -------------------------------------------------------------------------------


def _source(recording: cell.Recording) -> dict[str, dict[str, str | int]]:
    return {
        name: {"name": path.name, "bytes": path.stat().st_size, "sha256": _sha256(path)}
        for name, path in (("image", recording.image), ("cloud", recording.cloud))
        if path is not None
    }


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_unchanged(folder: cell.CampaignFolder, number: int, recording: cell.Recording) -> None:
    attachments = folder.attachments(number)
    if _SOURCE not in attachments:
        return
    before = json.loads(attachments[_SOURCE])
    for name, now in _source(recording).items():
        if before.get(name, {}).get("sha256") != now["sha256"]:
            place = folder.path / "captures" / f"{number:06d}"
            msg = (
                f"{now['name']} is not the file that was collected: it changed since. The capture "
                f"as it was is kept; delete {place} to take it anew"
            )
            raise InputError(msg)

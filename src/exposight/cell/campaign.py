"""A campaign: all captures of one part by one sensor, in memory or as a folder on disk.

The layout of the folder is in ``docs/formats.md``. Whatever was completely captured stays readable,
whenever the writer stops: each capture is a folder that appears whole or not at all
(`exposight.files.durable`).
"""

from __future__ import annotations

import json
import re
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from filelock import BaseFileLock

from exposight import files
from exposight.cell.capture import (
    Capture,
    CaptureDescription,
    CaptureKey,
    StoredAttachments,
    read_capture,
    read_description,
    write_capture,
)
from exposight.cell.feature_lists.feature_files import features_from_csv, features_to_csv
from exposight.cell.part import Part
from exposight.cell.sensor import ActiveSensor
from exposight.errors import FileError, FormatError, InputError, MissingFileError

_DESCRIPTION, _SENSOR, _FEATURES = "campaign.json", "sensor.json", "features.csv"
_CAPTURES = "captures"


_Keyed = TypeVar("_Keyed", Capture, CaptureDescription)


class CaptureSource(Protocol):
    """All captures of one part by one sensor, in a fixed order, wherever they are kept."""

    @property
    def name(self) -> str:
        """Name of the campaign."""
        ...

    @property
    def sensor(self) -> ActiveSensor:
        """The sensor that took every capture."""
        ...

    @property
    def part(self) -> Part:
        """The part that was measured."""
        ...

    def __len__(self) -> int:
        """Return the number of captures."""
        ...

    def captures(self) -> Iterator[Capture]:
        """Yield the captures one at a time, always in the same order."""
        ...


class MemoryCampaign:
    """A campaign whose captures are in memory.

    Parameters
    ----------
    name, sensor, part
        As in `CaptureSource`.
    captures : sequence of Capture
        At most one for each view and exposure time.

    Raises
    ------
    InputError
        If two captures have the same view and exposure time, or the name has control characters.
    ImageError, CloudError, SensorError
        If a capture cannot be this sensor's.
    """

    def __init__(
        self, *, name: str, sensor: ActiveSensor, part: Part, captures: Sequence[Capture]
    ) -> None:
        self.name = files.check_plain(name, "the campaign", InputError)
        self.sensor = sensor
        self.part = part
        keys: set[CaptureKey] = set()
        for capture in captures:
            _check_new(capture, sensor, keys, name)
            keys.add(capture.key)
        self._captures = tuple(captures)

    def __len__(self) -> int:
        return len(self._captures)

    def captures(self) -> Iterator[Capture]:
        """Yield the captures in the order they were given."""
        yield from self._captures


@dataclass(frozen=True, kw_only=True)
class _Description:
    """What ``campaign.json`` says."""

    name: str
    part: str
    sensor_sha256: files.Checksum
    features_sha256: files.Checksum

    def __post_init__(self) -> None:
        files.check_plain(self.name, "the campaign", InputError)


_FORMAT = files.DocumentFormat("exposight campaign", 1, _Description)


class CampaignFolder:
    """A campaign on disk, whose captures are read one at a time and verified by checksum.

    Captures come in the order they were taken. Captures added later appear when the folder is
    opened again.

    Parameters
    ----------
    path : Path
        The campaign's folder.

    Raises
    ------
    MissingFileError
        If the folder or one of its files is not there.
    DamagedFileError
        If a file's content is not what was written; the message names it.
    FormatError
        If it is no campaign.
    VersionError
        If a newer version of exposight wrote it.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        path = self.path / _DESCRIPTION
        if not path.is_file():
            msg = f"no campaign at {self.path}: expected a folder with {_DESCRIPTION} in it"
            raise MissingFileError(msg)
        description = _FORMAT.unseal(files.read_bytes(path, "campaign"), str(path))
        sensor = self._text(_SENSOR, description.sensor_sha256)
        features = self._text(_FEATURES, description.features_sha256)
        self.name = description.name
        self.sensor = ActiveSensor.from_json(sensor, source=str(self.path / _SENSOR))
        self.part = Part(
            name=description.part, features=features_from_csv(features, self.path / _FEATURES)
        )
        self.numbers = tuple(sorted(_capture_numbers(self.path / _CAPTURES)))

    def _text(self, name: str, sha256: str) -> str:
        data = files.read_verified(self.path / name, sha256, "file of a campaign")
        with files.parsing(self.path / name, "file of a campaign"):
            return data.decode("utf-8-sig")

    def __len__(self) -> int:
        return len(self.numbers)

    def captures(self) -> Iterator[Capture]:
        """Yield the captures one at a time, in the order they were taken; raises as `capture`.

        Raises
        ------
        FormatError
            Also if two are of the same view and exposure time: a folder was copied.
        """
        return self._once(map(self.capture, self.numbers))

    def capture(self, number: int) -> Capture:
        """Return one capture, by one of `numbers`.

        Raises
        ------
        MissingFileError, DamagedFileError, FormatError, VersionError
            If it cannot be read, or cannot be the sensor's; the message names the file.
        """
        return read_capture(_capture_path(self.path, number), self.sensor)

    def attachments(self, number: int) -> Mapping[str, bytes]:
        """Return a capture's attachments by name without reading its image and cloud.

        Each is read and verified when it is looked up; both raise as `capture`.
        """
        folder = _capture_path(self.path, number)
        return StoredAttachments(folder, read_description(folder).beside_sha256)

    def keys(self) -> tuple[CaptureKey, ...]:
        """Return the view and exposure time of every capture, in the order they were taken."""
        return tuple(description.key for description in self.descriptions())

    def descriptions(self) -> Iterator[CaptureDescription]:
        """Yield what is known of every capture without reading its image and cloud.

        Raises as `captures`, but for what images and clouds hold.
        """
        return self._once(self._description(number) for number in self.numbers)

    def _description(self, number: int) -> CaptureDescription:
        folder = _capture_path(self.path, number)
        description = read_description(folder)
        try:
            self.sensor.check_taken_exposure(description.exposure_ms)
        except InputError as error:
            msg = f"{folder}: {error}"
            raise FormatError(msg) from error
        return description

    def _once(self, captures: Iterator[_Keyed]) -> Iterator[_Keyed]:
        """Yield captures, each of another view and exposure time than all before."""
        known: dict[CaptureKey, int] = {}
        for number, capture in zip(self.numbers, captures, strict=True):
            first = known.setdefault(capture.key, number)
            if first != number:
                key = capture.key
                msg = (
                    f"{_capture_path(self.path, number)} holds a capture of view {key.view!r} at "
                    f"{key.exposure_ms:g} ms, and so does {_capture_path(self.path, first).name}; "
                    "was a folder copied? Remove one of them"
                )
                raise FormatError(msg)
            yield capture


class CampaignWriter:
    """Adds captures to a campaign on disk; `open_or_create` makes one.

    A folder has one writer at a time. Leaving a ``with`` block, or `close`, lets the next one in;
    so does the death of the process.
    """

    def __init__(self, campaign: CampaignFolder, lock: BaseFileLock) -> None:
        self._campaign = campaign
        self._keys = dict(zip(campaign.numbers, campaign.keys(), strict=True))
        self._release = weakref.finalize(self, lock.release)

    @classmethod
    def open_or_create(
        cls, path: Path, *, name: str, sensor: ActiveSensor, part: Part
    ) -> CampaignWriter:
        """Open a campaign's folder to add captures, or make it.

        Files that a killed writer left unfinished are removed.

        Parameters
        ----------
        path : Path
            The folder; made with its parents if it is not there.
        name : str
            Name of the campaign.
        sensor : ActiveSensor
            The sensor that takes every capture; the same as before, if the folder is there.
        part : Part
            The part that is measured; the same as before, if the folder is there.

        Raises
        ------
        InputError
            If the folder holds a campaign of another name, sensor or part, or the name has control
            characters.
        FormatError
            If the folder holds something else.
        FileError
            If another writer has it open, a file in it is damaged, or the disk refuses.
        """
        path = Path(path)
        _make_folder(path)
        lock = files.hold_writer_lock(path, "the campaign")
        try:
            _sweep(path)
            if not (path / _DESCRIPTION).exists():
                _create(path, name, sensor, part)
            campaign = CampaignFolder(path)
            _check_same(campaign, name, sensor, part)
            return cls(campaign, lock)
        except BaseException:
            lock.release()
            raise

    @property
    def keys(self) -> dict[int, CaptureKey]:
        """View and exposure time of every capture that is there by its number, in their order."""
        return dict(self._keys)

    def has(self, view: str, exposure_ms: float) -> bool:
        """Return whether a capture exists already, so that an interrupted campaign can continue."""
        return CaptureKey(view, exposure_ms) in self._keys.values()

    def add(self, capture: Capture) -> None:
        """Add a capture; it is on the disk, whole, when this returns.

        Raises
        ------
        InputError
            If there is one of this view and exposure time already, or it cannot be this sensor's.
        FileError
            If the writer is closed, the disk is full or refuses. What was there stays.
        """
        campaign = self._campaign
        if not self._release.alive:
            msg = f"the writer of {campaign.path} is closed; open the campaign again to add to it"
            raise FileError(msg)
        _check_new(capture, campaign.sensor, self._keys.values(), campaign.name)
        number = 1 + max(self._keys, default=-1)
        write_capture(_capture_path(campaign.path, number), capture)
        self._keys[number] = capture.key

    def sweep(self) -> None:
        """Remove files that killed worker processes of this writer left unfinished."""
        _sweep(self._campaign.path)

    def close(self) -> None:
        """Let the next writer in; closing twice does no harm."""
        self._release()

    def __enter__(self) -> CampaignWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def write_numbered_capture(campaign: Path, number: int, capture: Capture) -> None:
    """Write a capture under a given number, on behalf of a campaign's open writer.

    For the worker processes of a program that holds the campaign's `CampaignWriter`, which keeps
    other programs out and assigns the numbers. If two workers write the same capture, as after one
    of them was given up, the first one's is kept and neither fails.

    Parameters
    ----------
    campaign : Path
        The campaign's folder.
    number : int
        Where in the campaign's order the capture stands.
    capture : Capture
        Checked against the sensor by the caller (`Capture.check_fits`).

    Raises
    ------
    FileError
        If there is another capture of this number, the disk is full or refuses.
    """
    path = _capture_path(campaign, number)
    if _holds(path, capture.key):
        return
    try:
        write_capture(path, capture)
    except FileError:
        if not _holds(path, capture.key):  # else another worker was faster
            raise


def _sweep(campaign: Path) -> None:
    files.sweep_unfinished(campaign)
    files.sweep_unfinished(campaign / _CAPTURES)


def _holds(folder: Path, key: CaptureKey) -> bool:
    """Return whether a folder holds the capture of a view and exposure time."""
    try:
        return read_description(folder).key == key
    except FileError:
        return False


def _capture_path(campaign: Path, number: int) -> Path:
    return campaign / _CAPTURES / f"{number:06d}"


def _capture_numbers(folder: Path) -> Iterator[int]:
    for entry in folder.iterdir() if folder.is_dir() else ():
        if re.fullmatch(r"[0-9]{6,}", entry.name):  # neither unfinished nor a user's folder
            yield int(entry.name)


def _make_folder(path: Path) -> None:
    ours = {_CAPTURES, _SENSOR, _FEATURES, files.WRITER_LOCK}
    if path.is_dir() and not (path / _DESCRIPTION).exists():
        others = [e for e in path.iterdir() if e.name not in ours and not files.is_unfinished(e)]
        others += list((path / _CAPTURES).glob("[0-9]*"))
        if others:
            msg = (
                f"{path} holds {others[0].name} and no {_DESCRIPTION}, so it is no campaign; "
                "choose an empty folder or a new one"
            )
            raise FormatError(msg)
    files.make_folder(path / _CAPTURES, "a campaign")


def _create(path: Path, name: str, sensor: ActiveSensor, part: Part) -> None:
    sensor_json = sensor.to_json().encode()
    features_csv = features_to_csv(part.features).encode()
    description = _Description(
        name=name,
        part=part.name,
        sensor_sha256=files.sha256_of(sensor_json),
        features_sha256=files.sha256_of(features_csv),
    )
    files.write_durably(path / _SENSOR, sensor_json)
    files.write_durably(path / _FEATURES, features_csv)
    # Last, because its presence says that the campaign was made.
    files.write_durably(path / _DESCRIPTION, _FORMAT.seal(description))


def _check_same(campaign: CampaignFolder, name: str, sensor: ActiveSensor, part: Part) -> None:
    """Refuse to mix captures of different sensors or parts in one campaign."""
    if campaign.name != name:
        difference = f"is called {campaign.name!r} and not {name!r}"
    elif not files.alike(json.loads(campaign.sensor.to_json()), json.loads(sensor.to_json())):
        difference = f"was taken by a sensor {campaign.sensor.name!r} that differs from the one now"
    elif not files.alike(_outline(campaign.part), _outline(part)):
        difference = f"is of a part {campaign.part.name!r} that differs from the one now"
    elif finishes := _other_finish(campaign.part, part):
        difference = f"is of a part {campaign.part.name!r} whose {finishes}"
    else:
        return
    msg = f"the campaign in {campaign.path} {difference}; choose another folder for this one"
    raise InputError(msg)


def _outline(part: Part) -> list[object]:
    sizes = [[f.name, f.kind, f.radius_mm, f.length_mm, f.width_mm] for f in part.features]
    return [part.name, sizes, [f.part_from_feature.to_matrix().tolist() for f in part.features]]


def _other_finish(one: Part, other: Part) -> str:
    """Name a feature that is on different finishes; folders of earlier versions know of none."""
    for a, b in zip(one.features, other.features, strict=True):
        if a.finish and b.finish and a.finish != b.finish:
            return f"feature {a.name!r} was on {a.finish!r} and is on {b.finish!r} now"
    return ""


def _check_new(
    capture: Capture, sensor: ActiveSensor, known: Collection[CaptureKey], campaign: str
) -> None:
    """Check that a capture can be the sensor's, and is the only one of its view and exposure."""
    capture.check_fits(sensor)
    key = capture.key
    if key in known:
        msg = (
            f"campaign {campaign!r} already has a capture of view {key.view!r} at "
            f"{key.exposure_ms:g} ms; give the view another name, or skip what is there"
        )
        raise InputError(msg)

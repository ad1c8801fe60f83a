"""The served folder: models, campaigns, plans, parts and sensors, by their path in it.

Nothing that a request names is opened outside the folder. What was read is kept until its files
change.
"""

from __future__ import annotations

import logging
import os
import stat
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar, cast

from exposight.cell import PRESETS, ActiveSensor, Part, read_features, read_sensor
from exposight.errors import (
    ExposightError,
    FileError,
    FormatError,
    InputError,
    MissingFileError,
    SensorError,
    did_you_mean,
)
from exposight.files import spelled
from exposight.geometry import RigidTransform
from exposight.models import MODEL_SUFFIX
from exposight.observing import Campaign, open_campaign
from exposight.planning import ExposurePlan, SensorModels, read_exposure_plan

_LONGEST_NAME = 255
"""Characters of a name, and of each of its steps."""

_DEEPEST, _MOST_ENTRIES = 6, 20_000
"""How far below the folder, and among how many files, a listing looks."""

_MOST_KEPT = 64
"""Files and folders whose content is kept."""

_MOST_WARM = 8
"""Models and campaigns that are read before the first request."""

_HEAD = 400
"""Bytes of a JSON file in which its format is named, or it is none of ours."""

_CAMPAIGN_FILES = ("campaign.json", "sensor.json", "features.csv", "captures")

_logger = logging.getLogger(__name__)

_Value = TypeVar("_Value")
_Identity = tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, kw_only=True)
class Listing:
    """What a folder has, by name."""

    models: tuple[str, ...] = ()
    campaigns: tuple[str, ...] = ()
    exposure_plans: tuple[str, ...] = ()
    measuring_plans: tuple[str, ...] = ()
    features: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()


class ServedFolder:
    """A folder whose content requests name by relative paths with ``/``.

    Parameters
    ----------
    root : Path
        The folder.

    Raises
    ------
    MissingFileError
        If it is not there.
    """

    def __init__(self, root: Path) -> None:
        if not Path(root).is_dir():
            msg = f"no folder at {root}: give the folder with models and campaigns to serve"
            raise MissingFileError(msg)
        self.root = Path(root).resolve()
        self._kept: dict[tuple[str, str], tuple[_Identity, Any]] = {}
        self._unfinished: dict[Path, list[Path]] = {}
        self._lock = threading.Lock()

    # -- names ----------------------------------------------------------------------------------

    def inside(self, name: str, what: str = "file or folder") -> Path:
        """Return the path of something in the folder; ``.`` is the folder itself.

        Parameters
        ----------
        name : str
            Relative path, its steps joined by ``/``.
        what : str
            What it is, for messages.

        Raises
        ------
        InputError
            If it is no plain relative path.
        MissingFileError
            If there is nothing, or only by a link that leads out of the folder.
        FileError
            If it is a device, a pipe or the like.
        """
        path = self._resolved(name, what)
        try:
            kind = path.stat().st_mode
        except OSError as error:
            self.check_there()
            msg = f"no {what} {name!r} in the served folder{self._alike(name)}"
            raise MissingFileError(msg) from error
        if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
            msg = f"{name!r} is a device, a pipe or the like, no {what}"
            raise FileError(msg)
        return path

    def new(self, name: str, what: str = "file") -> Path:
        """Return the path of something that is to be made in the folder; nothing is made yet.

        Raises
        ------
        InputError, MissingFileError
            As `inside`.
        """
        if name in {"", "."}:
            msg = f"the {what} needs a name"
            raise InputError(msg)
        self.check_there()
        return self._resolved(name, what)

    def make_parent(self, path: Path) -> None:
        """Make the folder in which something new is to be written.

        Raises
        ------
        MissingFileError
            If the served folder is not there any more.
        FileError
            If the disk refuses.
        """
        self.check_there()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f"{self.name_of(path)!r} cannot be made: {error.strerror}"
            raise FileError(msg) from error

    def check_there(self) -> None:
        """Check that the served folder is still there.

        Raises
        ------
        MissingFileError
            If it was removed, or moved away.
        """
        if not self.root.is_dir():
            msg = "the served folder is not there any more: put it back, or serve another"
            raise MissingFileError(msg)

    def name_of(self, path: Path) -> str:
        """Return the name of a path in the folder."""
        return path.relative_to(self.root).as_posix()

    def without_root(self, message: object) -> str:
        """Return an error's message without the folder's own path, which is nobody's business."""
        return str(message).replace(f"{self.root}/", "")

    def has(self, path: Path) -> bool:
        """Tell whether a path in the folder stays in it where its links lead."""
        return Path(os.path.realpath(path)).is_relative_to(self.root)

    def _resolved(self, name: str, what: str) -> Path:
        check_name(name, what)
        path = Path(os.path.realpath(self.root / name))
        if not path.is_relative_to(self.root):
            msg = f"no {what} {name!r} in the served folder: it leads out of it"
            raise MissingFileError(msg)
        return path

    def _check_files(self, files: Iterable[Path]) -> None:
        """Check that files which lie side by side with others do not lead out of the folder."""
        for path in files:
            if not leads_into(path, self.root):
                msg = f"no file {self.name_of(path)!r} in the served folder: it leads out of it"
                raise MissingFileError(msg)

    def _alike(self, name: str) -> str:
        parent = self.root / PurePosixPath(name).parent
        try:
            names = [self.name_of(Path(each.path)) for each in os.scandir(parent)]
        except (OSError, ValueError):
            return ""
        return did_you_mean(name, names)

    # -- content --------------------------------------------------------------------------------

    def models(self, name: str, target: str = "p_norm") -> SensorModels:
        """Return the models in a folder, or of a model file.

        Raises
        ------
        ExposightError
            If they are not there, or not a quality and an exposure-time model.
        """
        path, files = self._models(name)

        def read() -> SensorModels:
            self._check_files(files)
            return SensorModels.load(path, target=target)

        return self._keep(f"models of {target}", path, files, read)

    def model_files(self, name: str) -> list[Path]:
        """Return the files of models, each of which is there.

        Raises
        ------
        ExposightError
            If there are none.
        """
        _, files = self._models(name)
        self._check_files(files)
        return files

    def _models(self, name: str) -> tuple[Path, list[Path]]:
        path = self.inside(name, "models")
        files = sorted(path.glob(f"*{MODEL_SUFFIX}")) if path.is_dir() else [path]
        if not files:
            msg = f"no models {name!r} in the served folder: expected *{MODEL_SUFFIX} files in it"
            raise MissingFileError(msg)
        return path, files

    def campaign(self, name: str) -> Campaign:
        """Return a campaign, with the captures that it has now.

        Captures without capture.json are not finished; they and those that lead out of the folder
        are left out.

        Raises
        ------
        ExposightError
            If it is not there, or damaged.
        """
        path = self.inside(name, "campaign")
        if not (path / "campaign.json").is_file():
            msg = f"no campaign {name!r} in the served folder{self._alike(name)}"
            raise MissingFileError(msg)
        return self._keep("campaign", path, self._deciding(path), lambda: self._opened(path))

    def captures(self, name: str) -> Path:
        """Return the path of a campaign, a capture's folder or a table whose files are all inside.

        Raises
        ------
        ExposightError
            If it is not there, or a file of it leads out of the folder.
        """
        path = self.inside(name, "captures")
        if path.is_dir():
            entries = [*path.iterdir(), *path.glob("captures/*"), *path.glob("captures/*/*")]
            self._check_files(each for each in entries if each.is_symlink())
        return path

    def _opened(self, path: Path) -> Campaign:
        self._check_files(path / each for each in _CAMPAIGN_FILES if (path / each).exists())
        campaign = open_campaign(path)
        folders = {number: path / "captures" / f"{number:06d}" for number in campaign.numbers}
        whole = [number for number, each in folders.items() if is_whole_capture(each, self.root)]
        self._unfinished[path] = [folders[each] for each in {*folders} - {*whole}]
        campaign.numbers = tuple(whole)
        return campaign

    def _deciding(self, path: Path) -> list[Path]:
        """Return whose change means that a campaign is to be read again."""
        captures = path / "captures"  # its time changes with every capture
        there = [captures] if captures.is_dir() else []
        return [path / "campaign.json", *there, *self._unfinished.get(path, ())]

    def view_poses(self, name: str) -> Mapping[str, RigidTransform]:
        """Return camera_from_part of the views that a campaign was measured from, by their name.

        Raises
        ------
        ExposightError
            As `campaign`.
        """
        path, campaign = self.inside(name, "campaign"), self.campaign(name)
        return self._keep(
            "poses",
            path,
            self._deciding(path),
            lambda: {each.view: each.camera_from_part for each in campaign.descriptions()},
        )

    def features(self, name: str) -> Part:
        """Return a part by its list of features.

        Raises
        ------
        ExposightError
            If it is not there, or no such list.
        """
        path = self._file(name, "list of features")
        return self._keep(
            "part",
            path,
            [path],
            lambda: Part(name=spelled(path.stem), features=read_features(path)),
        )

    def sensor(self, name: str) -> ActiveSensor:
        """Return a sensor by a preset's name, or its JSON file in the folder.

        Raises
        ------
        ExposightError
            If there is none.
        """
        if name in PRESETS:
            return PRESETS[name]
        if not name.lower().endswith(".json"):
            msg = (
                f"no sensor {name!r}: expected one of {', '.join(PRESETS)}, or a JSON file in the "
                f"served folder{did_you_mean(name, PRESETS)}"
            )
            raise SensorError(msg)
        path = self._file(name, "sensor")
        return self._keep("sensor", path, [path], lambda: read_sensor(path))

    def exposure_plan(self, name: str) -> ExposurePlan:
        """Return an exposure plan.

        Raises
        ------
        ExposightError
            If it is not there, or none.
        """
        path = self._file(name, "exposure plan")
        return self._keep("exposure plan", path, [path], lambda: read_exposure_plan(path))

    def _file(self, name: str, what: str) -> Path:
        path = self.inside(name, what)
        if path.is_dir():
            msg = f"{name!r} is a folder; expected the file of a {what}"
            raise FormatError(msg)
        return path

    def _keep(
        self, kind: str, path: Path, files: Iterable[Path], read: Callable[[], _Value]
    ) -> _Value:
        """Return what was read of files, or read it again where one of them has changed."""
        key, identity = (kind, str(path)), tuple(map(_identity, files))
        with self._lock:
            kept = self._kept.get(key)
            if kept is not None and kept[0] == identity:
                return cast("_Value", kept[1])
        value = read()
        with self._lock:
            self._kept.pop(key, None)
            self._kept[key] = identity, value
            while len(self._kept) > _MOST_KEPT:
                del self._kept[next(iter(self._kept))]
        return value

    def warm_up(self) -> None:
        """Read models and campaigns, and forecast once, so that the first request need not wait."""
        listing = self.listing()
        campaigns = [each for each in map(self._campaign_or_none, listing.campaigns) if each]
        for name in listing.models[:_MOST_WARM]:
            try:
                models = self.models(name)
                for campaign in campaigns[:_MOST_WARM]:
                    _forecast_once(models, campaign)
            except ExposightError as error:  # whoever asks for it is told
                _logger.info("%s: %s", name, error)

    def _campaign_or_none(self, name: str) -> Campaign | None:
        try:
            return self.campaign(name)
        except ExposightError as error:
            _logger.info("%s: %s", name, error)
            return None

    # -- listing --------------------------------------------------------------------------------

    def listing(self) -> Listing:
        """Return what the folder has, as far as its files' names and first bytes tell.

        Raises
        ------
        MissingFileError
            If the folder is not there any more.
        """
        self.check_there()
        found: dict[str, list[str]] = {name: [] for name in Listing.__dataclass_fields__}
        for folder, names in self._walk():
            place = self.name_of(folder)
            if any(name.endswith(MODEL_SUFFIX) for name in names):
                found["models"].append(place)
            if "campaign.json" in names:
                found["campaigns"].append(place)
                continue
            for name in names:
                if kind := _kind_of(folder / name):
                    found[kind].append(self.name_of(folder / name))
        return Listing(**{kind: tuple(sorted(names)) for kind, names in found.items()})

    def _walk(self) -> Iterator[tuple[Path, list[str]]]:
        """Yield folders with their files' names; not what is within a campaign."""
        left, waiting = _MOST_ENTRIES, [(self.root, 0)]
        while waiting and left > 0:
            folder, depth = waiting.pop()
            try:
                entries = sorted(os.scandir(folder), key=lambda entry: entry.name)[:left]
            except OSError:
                continue
            left -= len(entries)
            shown = [entry for entry in entries if not entry.name.startswith(".")]
            files = [each.name for each in shown if each.is_file(follow_symlinks=False)]
            yield folder, files
            if depth < _DEEPEST and "campaign.json" not in files:
                folders = [each for each in shown if each.is_dir(follow_symlinks=False)]
                waiting += [(Path(each.path), depth + 1) for each in reversed(folders)]


def _forecast_once(models: SensorModels, campaign: Campaign) -> None:
    """Compile what a recommendation runs through."""
    first = next(campaign.descriptions(), None)
    if first is not None and models.sensor == campaign.sensor:
        models.recommend(campaign.view(first.camera_from_part))


def check_name(name: str, what: str) -> None:
    """Check that a name is a plain relative path.

    Raises
    ------
    InputError
        If it is not.
    """
    steps = name.split("/")
    if len(name) > _LONGEST_NAME or any(len(each.encode()) > _LONGEST_NAME for each in steps):
        msg = f"the name of the {what} has {len(name)} characters; up to {_LONGEST_NAME} may be"
        raise InputError(msg)
    plain = name == "." or all(each not in {"", ".", ".."} for each in steps)
    if not plain or not name.isprintable() or any(each in name for each in "\\:"):
        msg = (
            f"{name!r} does not name a {what}: expected its path in the served folder, such as "
            "door/models, without .. and backslashes"
        )
        raise InputError(msg)


def leads_into(path: Path, root: Path) -> bool:
    """Tell whether something lies in a folder, links followed."""
    return Path(os.path.realpath(path)).is_relative_to(root)


def is_whole_capture(folder: Path, root: Path) -> bool:
    """Tell whether a capture's folder is finished, and it and all its files lie in a folder."""
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return False
    linked = [Path(each.path) for each in entries if each.is_symlink()]
    finished = any(each.name == "capture.json" and each.is_file() for each in entries)
    return finished and all(leads_into(each, root) for each in (folder, *linked))


def _identity(path: Path) -> tuple[int, int, int]:
    try:
        about = path.stat()
    except OSError:  # it was removed just now; who reads it says so
        return 0, 0, 0
    return about.st_mtime_ns, about.st_size, about.st_ino


def _kind_of(path: Path) -> str:
    """Return what a file is by its name and first bytes; empty where it is nothing of ours."""
    match path.suffix.lower():
        case ".json":
            return _kind_of_json(path)
        case ".toml" | ".yaml" | ".yml":
            return "measuring_plans"
        case ".csv" if "feature" in path.name.lower():
            return "features"
        case _:
            return ""


def _kind_of_json(path: Path) -> str:
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return ""
    if b'"exposight plan"' in head:
        return "exposure_plans"
    return "sensors" if b'"exposight sensor"' in head else ""

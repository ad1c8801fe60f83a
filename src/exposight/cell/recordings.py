"""Recordings as scanners leave them: images and clouds whose names tell view and exposure time."""

import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image as PillowImage

from exposight.cell.cloud_formats.cloud_files import READ_SUFFIXES
from exposight.cell.image_files import is_image
from exposight.errors import AmbiguousError, FormatError, InputError, MissingFileError
from exposight.files import UNITS_MS, ambiguous, current_reading, parsing

IMAGE_SUFFIXES = frozenset(
    {".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm"}
)
_CLOUDS = frozenset({*READ_SUFFIXES, ".npz"})
_UNITS = "msec|ms|usec|us|µs|μs|sec|s"
_UNIT = rf"(?P<unit>{_UNITS})(?![A-Za-z])"
_DECIMALS = r"\d+(?:[.,p_]\d+)?"
_PLAIN_NUMBER = r"\d+(?:[.,p]\d+)?"
_NUMBERS = {"exposure": "", "exposure:d": r"\d+", "exposure:f": _DECIMALS}
_MOST = 10


@dataclass(frozen=True, kw_only=True)
class Recording:
    """An image of a view at one exposure time, and its cloud.

    Parameters
    ----------
    view : str
        As the name tells it.
    image : Path
    cloud : Path or None
        None where none was found.
    exposure_ms : float or None
        None where the name does not tell it.
    """

    view: str
    image: Path
    cloud: Path | None
    exposure_ms: float | None


@dataclass(frozen=True, kw_only=True)
class Recordings:
    """What was found in a folder.

    Parameters
    ----------
    folder : Path
    found : tuple of Recording
        In the order of views and exposure times.
    faults : mapping of str to str
        Files that were left out, and why.
    remarks : tuple of str
        What was recognised.
    """

    folder: Path
    found: tuple[Recording, ...]
    faults: Mapping[str, str]
    remarks: tuple[str, ...] = ()


def find_recordings(
    folder: str | Path, *, name: str | None = None, cloud_name: str | None = None
) -> Recordings:
    """Find images and their clouds in a folder and its sub-folders.

    Parameters
    ----------
    folder : str or Path
    name : str, optional
        How images are named, from the folder on and without their suffix: ``P{view}_{exposure}ms``,
        ``{view}/{exposure}us/*``. ``{exposure:d}`` is a whole number, ``{exposure:f}`` one whose
        decimals may stand behind an underscore, ``{}`` and ``*`` stand for
        what does not matter. Recognised where it is left out.
    cloud_name : str, optional
        How clouds are named, with the same words; the image's own name by default.

    Raises
    ------
    MissingFileError
        If there is no such folder, or no image in it.
    FormatError
        If no image has such a name.
    AmbiguousError
        If names can be read in two ways.
    """
    folder = Path(folder)
    if not folder.is_dir():
        msg = f"{folder}: no such folder; expected one with images and clouds"
        raise MissingFileError(msg)
    files = sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith("."))
    clouds = _clouds(folder, files, cloud_name)
    if cloud_name is None:
        clouds = {**_depth_images(folder, files, clouds), **clouds}
    images = [path for path in files if _is_image(path) and path not in clouds.values()]
    if not images:
        msg = f"{folder}: no image in it ({', '.join(sorted(IMAGE_SUFFIXES))})"
        raise MissingFileError(msg)
    stems = [path.relative_to(folder).with_suffix("").as_posix() for path in images]
    if name is None:
        told, remarks = _recognised_names(stems, folder)
    else:
        told, remarks = _named(stems, name, folder), []
    found: list[Recording] = []
    faults: dict[str, str] = {}
    for path, stem, tells in zip(images, stems, told, strict=True):
        if tells is None:
            faults[path.relative_to(folder).as_posix()] = f"its name is not as in {name!r}"
            continue
        view, exposure_ms = tells
        cloud = clouds.get(stem if cloud_name is None else f"{view}\0{exposure_ms}")
        found.append(Recording(view=view, image=path, cloud=cloud, exposure_ms=exposure_ms))
    if not found:
        shown = ", ".join(stems[:4])
        msg = f"{folder}: none of its {len(stems)} images is named as in {name!r}: {shown}"
        raise FormatError(msg)
    kept = _once(found, folder, faults)
    kept.sort(key=lambda each: (_natural(each.view), each.exposure_ms or 0.0, str(each.image)))
    return Recordings(folder=folder, found=tuple(kept), faults=faults, remarks=tuple(remarks))


def _natural(text: str) -> list[tuple[bool, int, str]]:
    parts = re.split(r"(\d+)", text)
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]


def _is_image(path: Path) -> bool:
    if path.suffix.lower() in IMAGE_SUFFIXES:
        return True
    if path.suffix.lower() in _CLOUDS:
        return False
    with path.open("rb") as file:
        return is_image(file.read(8))


def _clouds(folder: Path, files: Sequence[Path], cloud_name: str | None) -> dict[str, Path]:
    """Return clouds by the stem of their image, or by view and exposure time."""
    if cloud_name is None:
        return {
            path.relative_to(folder).with_suffix("").as_posix(): path
            for path in files
            if path.suffix.lower() in _CLOUDS
        }
    stems = [path.relative_to(folder).with_suffix("").as_posix() for path in files]
    told = _named(stems, cloud_name, folder, suffixes=[path.suffix.lower() for path in files])
    return {
        f"{tells[0]}\0{tells[1]}": path
        for path, tells in zip(files, told, strict=True)
        if tells is not None
    }


def _depth_images(
    folder: Path, files: Sequence[Path], clouds: Mapping[str, Path]
) -> dict[str, Path]:
    """Return depth images by the stem of the image beside them, of which one alone is of 8 bits."""
    by_stem: dict[str, list[Path]] = {}
    for path in files:
        if path.suffix.lower() in IMAGE_SUFFIXES:
            stem = path.relative_to(folder).with_suffix("").as_posix()
            by_stem.setdefault(stem, []).append(path)
    found = {}
    for stem, pair in by_stem.items():
        if len(pair) != 2 or stem in clouds:
            continue
        deep = [path for path in pair if _is_deep(path)]
        if len(deep) == 1:
            found[stem] = deep[0]
    return found


def _is_deep(path: Path) -> bool:
    """Tell whether an image has one channel of more than 8 bits, from its head."""
    try:
        with (
            parsing(path, "image"),
            warnings.catch_warnings(action="ignore"),
            PillowImage.open(path) as image,
        ):
            return image.mode.startswith(("I", "F"))
    except FormatError:
        return False


def _once(found: Sequence[Recording], folder: Path, faults: dict[str, str]) -> list[Recording]:
    """Leave out images of which there are several of one view and exposure time."""
    known = [each for each in found if each.exposure_ms is not None]
    counts = Counter((each.view, each.exposure_ms) for each in known)
    kept = []
    for each in found:
        if counts[each.view, each.exposure_ms] > 1:
            others = [
                other.image.relative_to(folder).as_posix()
                for other in known
                if (other.view, other.exposure_ms) == (each.view, each.exposure_ms)
                and other is not each
            ]
            faults[each.image.relative_to(folder).as_posix()] = (
                f"of the same view {each.view!r} and {each.exposure_ms:g} ms as {others[0]}: tell "
                "them apart by --name"
            )
        else:
            kept.append(each)
    if not kept:
        first, why = next(iter(faults.items()))
        msg = f"{folder}: {first}: {why}"
        raise FormatError(msg)
    return kept


# -- names by a pattern -------------------------------------------------------------------------

_Told = tuple[str, float | None]


def _named(
    stems: Sequence[str], pattern: str, folder: Path, suffixes: Sequence[str] | None = None
) -> list[_Told | None]:
    """Return view and exposure time of names, None of those that are not as the pattern says."""
    suffix = Path(pattern).suffix.lower()
    bare = pattern
    if suffix in IMAGE_SUFFIXES | _CLOUDS or suffix == ".*":
        bare = pattern[: -len(suffix)]
    regular = _regular(bare, _DECIMALS, greedy=False)
    is_told = "{exposure:" in bare
    whole = regular if is_told else _regular(bare, _PLAIN_NUMBER, greedy=True)
    told: list[_Told | None] = []
    other: list[_Told | None] = []
    for position, stem in enumerate(stems):
        if suffixes is not None and suffix in IMAGE_SUFFIXES | _CLOUDS:
            fits = suffixes[position] == suffix
        else:
            fits = suffixes is None or suffixes[position] in IMAGE_SUFFIXES | _CLOUDS
        told.append(_told(regular.fullmatch(stem), folder) if fits else None)
        other.append(_told(whole.fullmatch(stem), folder) if fits else None)
    pairs = list(zip(told, other, strict=True))
    differing = [one is not None and one != two for one, two in pairs]
    if not any(differing):
        return told
    # P01_7_5ms beside P01_10ms has decimals: view P01 is there without them.
    plain = {one[0] for one, two in pairs if one is not None and one == two}
    if {one[0] for one in told if one is not None} <= plain:
        return told
    i = differing.index(True)
    msg = (
        f"{folder}: {stems[i]} as {pattern!r} is view {_shown(told[i])}, or view "
        f"{_shown(other[i])}: write {{exposure:f}} where decimals stand behind an underscore, "
        "{exposure:d} for whole numbers"
    )
    raise AmbiguousError(msg, ("{exposure:f}", "{exposure:d}"))


def _shown(told: _Told | None) -> str:
    return "of none" if told is None else f"{told[0]!r} at {told[1]:g} ms"


def _regular(pattern: str, number: str, *, greedy: bool) -> "re.Pattern[str]":
    """Return the regular expression of a pattern such as ``P{view}_{exposure}ms``."""
    parts = re.split(r"(\{[^{}]*\}|\*)", pattern)
    out, has_unit, seen = [], False, set[str]()
    for i, part in enumerate(parts):
        key = part[1:-1] if part.startswith("{") else ""
        if part in {"{}", "*"}:
            out.append("[^/]*?")
        elif key == "view" and "view" not in seen:
            is_greedy = greedy or "{exposure:d}" in pattern
            out.append("(?P<view>[^/]+)" if is_greedy else "(?P<view>[^/]+?)")
        elif key in _NUMBERS and "exposure" not in seen:
            out.append(f"(?P<exposure>{_NUMBERS[key] or number})")
            unit = re.match(rf"\s*{_UNIT}", parts[i + 1] if i + 1 < len(parts) else "")
            if unit:
                parts[i + 1] = parts[i + 1][unit.end() :]
                out.append(rf"\s*(?P<unit>{unit['unit']})")
                has_unit = True
        elif key == "unit" and not has_unit:
            out.append(f"(?P<unit>{_UNITS})")
            has_unit = True
        elif part.startswith("{"):
            msg = (
                f"--name {pattern!r}: expected {{view}} and {{exposure}} once each, {{unit}}, {{}} "
                f"or *, got {part}"
            )
            raise InputError(msg)
        else:
            out.append(re.escape(part))
        seen.add(key.split(":")[0])
    if "view" not in seen and "exposure" not in seen:
        msg = f"--name {pattern!r} must have {{view}} or {{exposure}} in it"
        raise InputError(msg)
    return re.compile("".join(out), re.IGNORECASE)


def _told(match: "re.Match[str] | None", folder: Path) -> _Told | None:
    if match is None:
        return None
    groups = match.groupdict()
    view = groups.get("view") or "view"
    number = groups.get("exposure")
    if number is None:
        return view, None
    return view, _milliseconds(number, groups.get("unit"), folder, match.string)


def _milliseconds(number: str, unit: str | None, folder: Path, name: str) -> float:
    value = float(re.sub(r"[,p_]", ".", number.lower()))
    unit = _unit(unit) if unit else current_reading().exposure
    if unit is None:
        raise ambiguous(
            folder,
            f"in which unit is the exposure time {number} of {name}?",
            "exposure",
            {each: f"{scale * value:g} ms" for each, scale in UNITS_MS.items()},
        )
    return round(value * UNITS_MS[unit], 9)


def _unit(word: str) -> str:
    word = word.lower().replace("µ", "u").replace("μ", "u")
    return {"msec": "ms", "usec": "us", "sec": "s"}.get(word, word)


# -- names without a pattern --------------------------------------------------------------------

_TIME = re.compile(
    rf"(?<![A-Za-z0-9.,])(?P<exposure>{_PLAIN_NUMBER})\s?{_UNIT}|"
    rf"(?<![A-Za-z0-9.,])(?P<long>\d+_\d+)\s?(?P<unit2>{_UNITS})(?![A-Za-z])",
    re.IGNORECASE,
)


def _recognised_names(stems: Sequence[str], folder: Path) -> tuple[list[_Told | None], list[str]]:
    """Return view and exposure time of names which all have one number with a unit of time."""
    times = [list(re.finditer(_TIME, stem)) for stem in stems]
    if not any(times):
        return [(view, None) for view in _views(stems)], []
    odd = [stem for stem, found in zip(stems, times, strict=True) if len(found) != 1]
    if odd:
        shown = ", ".join(odd[:_MOST])
        msg = (
            f"{folder}: an exposure time with its unit is not once in the name of {len(odd)} of "
            f"{len(stems)} images ({shown}): say how they are named: --name "
            '"P{view}_{exposure}ms"'
        )
        raise AmbiguousError(msg, ("--name",))
    rests, told = [], []
    for stem, (found,) in zip(stems, times, strict=True):
        number, unit = found["exposure"], found["unit"] or found["unit2"]
        before = re.search(r"(?<![A-Za-z0-9])(\d+)_$", stem[: found.start()])
        if found["long"] or before:
            msg = (
                f"{folder}: {stem} may be at {number or found['long']} {unit}, or have decimals "
                "behind an underscore: say how it is named: --name"
            )
            raise AmbiguousError(msg, ("--name",))
        rests.append(stem[: found.start()] + stem[found.end() :])
        told.append(_milliseconds(number, unit, folder, stem))
    views = _views(rests)
    example = f"{stems[0]} is view {views[0]!r} at {told[0]:g} ms"
    return list(zip(views, told, strict=True)), [f"names tell view and exposure time: {example}"]


def _views(rests: Sequence[str]) -> list[str]:
    """Return what differs between names, or all of one where nothing does."""
    split = [[part for part in re.split(r"[/_\-. ]+", rest) if part] for rest in rests]
    lengths = {len(parts) for parts in split}
    if len(lengths) == 1 and len(rests) > 1:
        varies = [i for i in range(lengths.pop()) if len({parts[i] for parts in split}) > 1]
        if varies:
            return ["_".join(parts[i] for i in varies) for parts in split]
    return ["_".join(parts) or "view" for parts in split]


# -- exposure times within files ----------------------------------------------------------------

_EXIF, _EXPOSURE_TIME = 0x8769, 0x829A
_LONGEST_S = 3600.0
"""Longer exposures are an astronomer's, or a damaged file's."""


def exif_exposure_ms(path: str | Path) -> float | None:
    """Return the exposure time that an image's EXIF tells, ms; None where it tells none."""
    try:
        with parsing(path, "image"), warnings.catch_warnings(action="ignore"):
            with PillowImage.open(path) as image:
                exif = image.getexif()
            value = exif.get_ifd(_EXIF).get(_EXPOSURE_TIME, exif.get(_EXPOSURE_TIME))
            seconds = float(value) if value is not None else 0.0
    except FormatError:
        return None  # whatever reads the image says what is wrong with it
    return 1e3 * seconds if 0.0 < seconds <= _LONGEST_S else None

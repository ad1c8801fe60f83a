"""Which pose and which exposure time each image of a folder has."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from exposight import cell
from exposight.errors import InputError, did_you_mean, first_ten
from exposight.geometry import RigidTransform
from exposight.measuring.capture_table import CaptureTable

_ALIKE = 0.02
"""Share by which exposure times of two sources may differ: names are rounded."""


def match_views(
    views: Sequence[str], poses: Mapping[str, RigidTransform], folder: Path
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the name of each view's pose, and what was recognised on the way.

    Raises
    ------
    InputError
        If views have no pose, or several poses could be a view's.
    """
    if list(poses) == ["1"]:  # a single pose without a name
        return dict.fromkeys(views, "1"), ("one pose for all views",) if len(views) > 1 else ()
    found: dict[str, str] = {}
    faults, other_names = [], []
    for view in views:
        names = _names_of(view, poses)
        if len(names) == 1:
            found[view] = names[0]
            if names[0] != view:
                other_names.append(f"{names[0]} is view {view}")
        elif names:
            faults.append(f"view {view!r} may be {' or '.join(names)}")
        else:
            faults.append(f"view {view!r} has no pose{did_you_mean(view, poses)}")
    if faults:
        had = ", ".join(list(poses)[:10]) or "none"
        msg = f"{folder}: {len(faults)} of {len(views)} views: {first_ten(faults)}; poses: {had}"
        raise InputError(msg)
    said = f"poses by their number: {', '.join(other_names[:3])}" if other_names else ""
    return found, tuple(filter(None, [said]))


def _names_of(view: str, poses: Iterable[str]) -> list[str]:
    """Return the poses that a view's name means: the same, but for capitals, or by its number."""
    every = list(poses)
    if view in every:
        return [view]
    plain = re.sub(r"[^a-z0-9]", "", view.lower())
    same = [name for name in every if re.sub(r"[^a-z0-9]", "", name.lower()) == plain]
    if same:
        return same
    numbers = _number(view)
    return [name for name in every if numbers is not None and _number(name) == numbers]


def _number(name: str) -> int | None:
    """Return the one number of a name."""
    found = re.findall(r"\d+", name)
    return int(found[0]) if len(found) == 1 else None


def timed_recordings(
    recordings: cell.Recordings, table: CaptureTable | None, left_out: dict[str, str]
) -> Iterator[cell.Recording]:
    """Yield recordings with their exposure time: of the name, the EXIF or the table.

    Parameters
    ----------
    recordings : Recordings
    table : CaptureTable, optional
    left_out : dict of str to str
        Receives files whose exposure time is not known, or contradicted, and why.
    """
    timed: list[cell.Recording] = []
    for each in recordings.found:
        label = each.image.relative_to(recordings.folder).as_posix()
        try:
            exposure_ms = _exposure_ms(each, table, label)
        except InputError as error:
            left_out[label] = str(error)
            continue
        timed.append(replace(each, exposure_ms=exposure_ms))
    counts = Counter((each.view, each.exposure_ms) for each in timed)
    for each in timed:
        if counts[each.view, each.exposure_ms] > 1:
            label = each.image.relative_to(recordings.folder).as_posix()
            left_out[label] = f"another image is of view {each.view!r} and {each.exposure_ms:g} ms"
        else:
            yield each


def _exposure_ms(recording: cell.Recording, table: CaptureTable | None, label: str) -> float:
    """Return the exposure time that a recording's sources agree on.

    Raises
    ------
    InputError
        If none tells it, or two do not agree.
    """
    told = {
        "its name": recording.exposure_ms,
        "its EXIF": cell.exif_exposure_ms(recording.image),
        "the table": None if table is None else table.exposure_ms(label, recording.view),
    }
    if table is not None and told["the table"] is None and (table.by_file or table.by_view):
        msg = f"{table.source} has no exposure time of it"
        raise InputError(msg)
    known = {source: value for source, value in told.items() if value is not None}
    if not known:
        msg = (
            "its exposure time is not known: neither its name (--name), nor its EXIF, nor a table "
            "(--table) tells it"
        )
        raise InputError(msg)
    low, high = min(known.values()), max(known.values())
    if high > (1 + _ALIKE) * low:
        spelled = ", ".join(f"{source} says {value:g} ms" for source, value in known.items())
        msg = f"contradiction: its exposure time: {spelled}; which one is right?"
        raise InputError(msg)
    return next(iter(known.values()))

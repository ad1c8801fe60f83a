"""A table about captures: exposure times and poses of files or views, as operators keep them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from exposight.errors import FormatError
from exposight.files import Wanted, match_columns, read_table
from exposight.geometry import RigidTransform, is_pose_header, poses_of_table

_FILE = ("file", "image", "filename", "file_name", "image_file", "bild", "datei", "bilddatei")
_VIEW = ("view", "ansicht", "position", "station", "pose", "punkt", "viewpoint")
_EXPOSURE = ("exposure_ms", "exposure_time", "exposure", "t_exp", "texp", "belichtung",
             "belichtungszeit", "integration_time", "shutter")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CaptureTable:
    """What a table says of files or views.

    Parameters
    ----------
    source : str
    by_file, by_view : mapping of str to float
        Exposure times, ms, by the image's name without folder and suffix, or by the view.
    poses : mapping of str to RigidTransform
        By view.
    """

    source: str
    by_file: Mapping[str, float]
    by_view: Mapping[str, float]
    poses: Mapping[str, RigidTransform]

    def exposure_ms(self, file: str, view: str) -> float | None:
        """Return the exposure time of an image; None where the table tells none."""
        stem = _stem(file)
        return self.by_file.get(stem, self.by_view.get(view.lower()))


def _stem(file: str) -> str:
    return PurePosixPath(file.replace("\\", "/")).stem.lower()


def read_capture_table(path: str | Path) -> CaptureTable:
    """Read a table of captures in any dialect.

    It has a column with files or views, exposure times, and perhaps poses by their usual names.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError
        If it has neither files nor views, or a row's exposure time is none.
    AmbiguousError
        If the unit of exposure times, or something else, is open.
    """
    table = read_table(path, "table of captures")
    columns = match_columns(
        table.header,
        [
            Wanted(name="file", aliases=_FILE, quantity="text", required=False),
            Wanted(name="view", aliases=_VIEW, quantity="text", required=False),
            Wanted(name="exposure_ms", aliases=_EXPOSURE, quantity="time", required=False),
        ],
        path,
    )
    if "file" not in columns and "view" not in columns:
        msg = f"{path}: expected a column file or view, got {', '.join(table.header)}"
        raise FormatError(msg)
    files = table.texts(columns["file"].index) if "file" in columns else [""] * len(table)
    views = table.texts(columns["view"].index) if "view" in columns else [""] * len(table)
    times: list[float | None] = [None] * len(table)
    if "exposure_ms" in columns:
        column = columns["exposure_ms"]
        numbers = column.factor * np.atleast_1d(table.numbers(column.index))
        times = [float(each) if np.isfinite(each) else None for each in numbers]
        if bad := [i for i, each in enumerate(times) if each is not None and each <= 0]:
            lines = ", ".join(str(table.lines[i]) for i in bad[:10])
            msg = f"{path}: exposure times must be above 0, got others in {len(bad)} lines: {lines}"
            raise FormatError(msg)
    poses: dict[str, RigidTransform] = {}
    if is_pose_header(list(table.header)) and "view" in columns:
        for view, pose in zip(views, poses_of_table(table), strict=True):
            known = poses.setdefault(view, pose.pose)
            if not np.allclose(known.to_matrix(), pose.pose.to_matrix(), atol=1e-6):
                msg = f"{path}: view {view!r} has two poses"
                raise FormatError(msg)
    table.say()
    by_view = {}
    if "file" not in columns:
        by_view = _once(path, views, times)
    return CaptureTable(
        source=str(path),
        by_file=_once(path, [_stem(file) for file in files], times) if "file" in columns else {},
        by_view=by_view,
        poses=poses,
    )


def _once(path: str | Path, keys: list[str], times: list[float | None]) -> dict[str, float]:
    """Return the exposure time of each key that has one alone."""
    found: dict[str, float] = {}
    for key, time in zip(keys, times, strict=True):
        if time is None:
            continue
        if found.setdefault(key.lower(), time) != time:
            msg = f"{path}: {key!r} has the exposure times {found[key.lower()]:g} and {time:g} ms"
            raise FormatError(msg)
    return found

"""Poses in files of any form: matrices, robots' programs, documents, tables and trajectories."""

import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from exposight.errors import InputError, MissingFileError, PoseError, did_you_mean
from exposight.files import Reading, read_bytes, reading_as, recognised
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_matrices import matrix_pose, plain_poses
from exposight.geometry.robot_poses.pose_tables import table_poses
from exposight.geometry.robot_poses.pose_texts import poses_in_text
from exposight.geometry.robot_poses.printed_poses import WrittenPose

_MOST_BYTES = 50_000_000
_NAMED = 6


def read_named_poses(
    path: str | Path, notation: str | None = None, reading: Reading | None = None
) -> dict[str, RigidTransform]:
    """Read all poses of a file, each with its name.

    Parameters
    ----------
    path : str or Path
        A robot's program (KUKA .src or .dat, ABB module, Fanuc .LS, URScript), a JSON or YAML
        document, a table with a header, lines of numbers, an array (.npy), or a folder with one
        pose a file, which gives it its name.
    notation : str, optional
        A `PoseNotation` for numbers without letters; recognised where it is None.
    reading : Reading, optional
        What the file does not tell.

    Returns
    -------
    dict of str to RigidTransform
        In the file's order; poses without a name are numbered from 1.

    Raises
    ------
    MissingFileError
        If it is not there.
    PoseError
        If there is no pose in it, one is none, or two have one name.
    AmbiguousError
        If two readings fit, and nobody said which it is.
    """
    path = Path(path)
    with reading_as(reading or Reading()):
        if path.is_dir():
            return _of_folder(path, notation)
        found = _poses_in(path, notation)
    names = [pose.name for pose in found]
    if not all(names):
        names = [name or str(number) for number, name in enumerate(names, start=1)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        msg = f"{path}: {len(twice)} names are there twice: {', '.join(twice[:10])}"
        raise PoseError(msg)
    return dict(zip(names, (pose.pose for pose in found), strict=True))


def read_pose(
    path: str | Path, notation: str | None = None, reading: Reading | None = None
) -> RigidTransform:
    """Read a pose from a file in any of the forms of `read_named_poses`.

    Parameters
    ----------
    path : str or Path
        The file; of several poses one is chosen by its name: ``program.ls#P[3]``.
    notation, reading
        As for `read_named_poses`.

    Raises
    ------
    MissingFileError, PoseError, AmbiguousError
        As for `read_named_poses`; if there are several poses and none was chosen.
    """
    file, chosen = _split(Path(path))
    if not file.is_file() and not (chosen and file.is_dir()):
        msg = (
            f"{file}: no such pose file; expected a 4×4 matrix, 16 numbers row by row, in mm, or a "
            "pose as a robot prints it"
        )
        raise MissingFileError(msg)
    poses = read_named_poses(file, notation, reading)
    if chosen:
        if chosen not in poses:
            msg = f"{file}: no pose is called {chosen!r}; there are {_listed(poses)}"
            raise PoseError(msg + did_you_mean(chosen, poses))
        return poses[chosen]
    if len(poses) > 1:
        msg = (
            f"{file}: {len(poses)} poses: {_listed(poses)}; say which one: "
            f"'{file}#{next(iter(poses))}'"
        )
        raise PoseError(msg)
    return next(iter(poses.values()))


def _split(path: Path) -> tuple[Path, str]:
    if path.exists() or "#" not in path.name:
        return path, ""
    name, _, chosen = path.name.partition("#")
    return path.with_name(name), chosen


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - _NAMED} others" if len(every) > _NAMED else ""
    return ", ".join(every[:_NAMED]) + more


def _of_folder(folder: Path, notation: str | None) -> dict[str, RigidTransform]:
    files = sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))
    faults, poses = [], {}
    for file in files:
        try:
            poses[file.stem] = read_pose(file, notation)
        except InputError as error:
            faults.append(error)
    if faults and (len(faults) == len(files) or len(files) == 1):
        raise faults[0]
    if faults:
        spelled = "; ".join(str(fault) for fault in faults[:10])
        msg = f"{folder}: {len(faults)} of {len(files)} files are no poses: {spelled}"
        raise PoseError(msg)
    if not poses:
        msg = f"{folder}: no file with a pose in it"
        raise PoseError(msg)
    return poses


def _poses_in(path: Path, notation: str | None) -> list[WrittenPose]:
    if not path.is_file():
        msg = f"{path}: no such pose file"
        raise MissingFileError(msg)
    if path.stat().st_size > _MOST_BYTES:
        msg = f"{path}: {path.stat().st_size} bytes are too many for a file of poses"
        raise PoseError(msg)
    data = read_bytes(path, "file of poses")
    try:
        if data[:6] == b"\x93NUMPY":
            found = _of_array(data, path)
        else:
            found = [] if notation else table_poses(data, path)
            found = found or poses_in_text(_decoded(data), path, notation)
    except PoseError as error:
        if str(path) in str(error):
            raise
        msg = f"{path}: {error}"
        raise error.named(msg) from error
    said = [_said(found, is_text=data[:6] != b"\x93NUMPY")]
    said += list(dict.fromkeys(pose.remark for pose in found if pose.remark))
    recognised(path, *filter(None, said))
    return found


def _said(found: Sequence[WrittenPose], *, is_text: bool) -> str:
    """Return as what poses were recognised; nothing of plain matrices, as exposight has them."""
    forms = dict.fromkeys(pose.form for pose in found)
    if list(forms) == ["4×4 matrix, mm"] and is_text:
        return ""
    count = f"{len(found)} poses, " if len(found) > 1 else ""
    return count + "; ".join(filter(None, forms))


def _decoded(data: bytes) -> str:
    for start, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"", "utf-8-sig")):
        if data.startswith(start):
            try:
                return data.decode(encoding)
            except UnicodeDecodeError:
                continue
    return data.decode("cp1252", errors="replace")


def _of_array(data: bytes, path: Path) -> list[WrittenPose]:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
        array = np.asarray(array, dtype=np.float64)
    except (ValueError, TypeError, EOFError, OSError) as error:
        msg = f"{path} is no array of numbers ({error})"
        raise PoseError(msg) from error
    if array.ndim == 3 and array.shape[1:] in {(4, 4), (3, 4)}:
        return [matrix_pose(matrix, path) for matrix in array]
    if array.shape in {(4, 4), (3, 4)}:
        return [matrix_pose(array, path)]
    rows = np.atleast_2d(array) if array.ndim <= 2 else array.reshape(len(array), -1)
    return plain_poses([("", row.tolist()) for row in rows], path)

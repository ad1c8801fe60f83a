"""Poses in texts and files of any form: matrices, programs, documents, tables, trajectories."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml

from exposight.errors import FormatError, InputError, MissingFileError, PoseError, did_you_mean
from exposight.files import (
    Reading,
    SafeLoader,
    check_plain,
    check_yaml,
    parsing,
    read_array,
    read_bytes,
    reading_as,
    recognised,
)
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_documents import (
    document_poses,
    loose_numbers,
)
from exposight.geometry.robot_poses.pose_notations import (
    matrix_pose,
    plain_poses,
    poses_of_notation,
)
from exposight.geometry.robot_poses.pose_numbers import NUMBER, number_rows, numbers_of
from exposight.geometry.robot_poses.pose_tables import named_numbers_pose, table_poses
from exposight.geometry.robot_poses.printed_poses import WrittenPose, printed_poses


def parse_pose(notation: str | None, text: str, source: str | Path = "the pose") -> RigidTransform:
    """Read a pose as a robot writes it.

    Parameters
    ----------
    notation : str or None
        One of `PoseNotation`; None or "printed" where the text tells it itself, as
        ``{X 12.3,Y -4,…}``, ``p[…]`` and robtargets do.
    text : str
        What the controller prints, or the pose's numbers; see `pose_from_numbers`.
    source : str or Path
        Where it is from, for messages.

    Raises
    ------
    PoseError
        As for `pose_from_numbers`, and if one is not a number, or the text is of another notation.
    AmbiguousError
        If two readings fit equally well.
    """
    found = poses_in_text(text, source, notation)
    if len(found) > 1:
        msg = f"{source}: expected one pose, got {len(found)}"
        raise PoseError(msg)
    recognised(source, *filter(None, [found[0].remark]))
    return found[0].pose


def poses_in_text(text: str, source: str | Path, notation: str | None = None) -> list[WrittenPose]:
    """Return the poses in a text of any form.

    Raises
    ------
    PoseError
        If there is none, or one is none.
    AmbiguousError
        If two readings fit.
    """
    # Numbers that overflow are met by the checks of poses.
    with parsing(source, "pose"), np.errstate(all="ignore"):
        return _found_in(text, source, notation)


def _found_in(text: str, source: str | Path, notation: str | None) -> list[WrittenPose]:
    if notation not in {None, "printed"}:
        return poses_of_notation(str(notation), text, source)
    if not text.strip():
        msg = f"{source}: empty; a pose needs 16 numbers, or what a robot prints"
        raise PoseError(msg)
    stripped = text.lstrip()
    if stripped[0] in "{[":
        try:
            document = json.loads(text, object_pairs_hook=partial(_once, source), parse_int=_whole)
            found = document_poses(document, source)
        except (json.JSONDecodeError, RecursionError):
            document, found = None, []
        if found:
            return found
        if loose := loose_numbers(document):
            return plain_poses(loose, source)
    found = printed_poses(text, source)
    if found:
        return found
    found = _of_yaml(text, source)
    if found:
        return found
    if pose := _key_values(text, source):
        return [pose]
    ways = number_rows(text)
    faults: list[InputError] = []
    for rows in ways:
        try:
            return plain_poses(rows, source)
        except InputError as error:
            faults.append(error)
    if faults:
        raise next((f for f in faults if not isinstance(f, PoseError)), faults[0])
    msg = (
        f"{source}: no pose in it: neither 16 numbers (a 4×4 matrix row by row, in mm) nor what "
        "robots, ROS, HALCON or Zivid write; got something else"
    )
    raise PoseError(msg)


_KEY_VALUE = re.compile(
    rf"(?<![\w.])([A-Za-z]\w*(?:\s*[\[(](?:mm|m|deg|rad|°)[\])])?)\s*[:=]\s*({NUMBER})"
)


def _key_values(text: str, source: str | Path) -> WrittenPose | None:
    """Return the pose of a text such as ``x_mm=12.5, y_mm=-3, …``."""
    pairs = _KEY_VALUE.findall(text)
    if len({key for key, _ in pairs}) < len(pairs):
        return None
    numbers = numbers_of([word for _, word in pairs], source)
    return named_numbers_pose(dict(zip((key for key, _ in pairs), numbers, strict=True)), source)


def _once(source: str | Path, pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    """Return a map whose keys are there once: of two values nobody knows which is meant."""
    found: dict[Any, Any] = {}
    for key, value in pairs:
        if key in found:
            msg = f"{source}: the key {key!r} is there twice"
            raise PoseError(msg)
        found[key] = value
    return found


def _whole(digits: str) -> float:
    """Return a number of any length, which Python's whole ones do not have."""
    return int(digits) if len(digits) < _DIGITS else float(digits)


_DIGITS = 300


class _Loader(SafeLoader):  # type: ignore[misc]  # PyYAML carries no types
    """The safe loader, which takes unknown tags for what they tag, and each key once."""

    yaml_implicit_resolvers: ClassVar[dict[str, object]] = dict(SafeLoader.yaml_implicit_resolvers)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        _once(f"line {node.start_mark.line + 1}", ((key, None) for key in keys))
        return super().construct_mapping(node, deep)  # type: ignore[no-any-return]


def _untagged(loader: Any, _: str, node: yaml.Node) -> object:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_Loader.add_multi_constructor("", _untagged)
_Loader.add_implicit_resolver(  # YAML 1.1 wants a point in 1e-3
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?\d+[eE][-+]?\d+$"),
    [*"-+0123456789"],
)


def _of_yaml(text: str, source: str | Path) -> list[WrittenPose]:
    text = re.sub(r"^\s*%YAML.*$", "", text, count=1, flags=re.MULTILINE)
    if not re.search(r"^\s*-?\s*[\w\"'.$\[\]]+\s*:(\s|$)", text, re.MULTILINE):
        return []
    try:
        check_yaml(text)
        documents = list(yaml.load_all(text, Loader=_Loader))
    except (PoseError, FormatError) as error:
        msg = f"{source}: {error}"
        raise PoseError(msg) from error
    except (yaml.YAMLError, ValueError):
        return []
    return [pose for document in documents for pose in document_poses(document, source)]


_MOST_BYTES = 10_000_000
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
    names = [check_plain(pose.name, "a pose's name") for pose in found]
    if not all(names):
        names = [name or str(number) for number, name in enumerate(names, start=1)]
    twice = sorted(name for name, number in Counter(names).items() if number > 1)
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
        with parsing(path, "file of poses"), np.errstate(all="ignore"):
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
    array = read_array(data, path, "file of poses").astype(np.float64)
    if array.ndim == 3 and array.shape[1:] in {(4, 4), (3, 4)}:
        return [matrix_pose(matrix, path) for matrix in array]
    if array.shape in {(4, 4), (3, 4)}:
        return [matrix_pose(array, path)]
    rows = np.atleast_2d(array) if array.ndim <= 2 else array.reshape(len(array), -1)
    return plain_poses([("", row.tolist()) for row in rows], path)

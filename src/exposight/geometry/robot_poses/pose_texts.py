"""Poses in a text of any form: what robots print, JSON, YAML, and lines of numbers."""

import json
import re
from pathlib import Path
from typing import ClassVar

import yaml

from exposight.errors import InputError, PoseError
from exposight.files import recognised
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_documents import (
    document_poses,
    loose_numbers,
    named_numbers_pose,
)
from exposight.geometry.robot_poses.pose_matrices import plain_poses
from exposight.geometry.robot_poses.pose_numbers import NUMBER, number_rows, numbers_of
from exposight.geometry.robot_poses.printed_poses import WrittenPose, printed_poses
from exposight.geometry.robot_poses.written_poses import poses_of_notation


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
    if notation not in {None, "printed"}:
        return poses_of_notation(str(notation), text, source)
    if not text.strip():
        msg = f"{source}: empty; a pose needs 16 numbers, or what a robot prints"
        raise PoseError(msg)
    stripped = text.lstrip()
    if stripped[0] in "{[":
        try:
            document = json.loads(text)
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


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML carries no types
    """The safe loader, which takes unknown tags for what they tag, and no aliases."""

    yaml_implicit_resolvers: ClassVar[dict[str, object]] = dict(
        yaml.SafeLoader.yaml_implicit_resolvers
    )

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node | None:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            problem = "aliases are not read"
            raise yaml.composer.ComposerError(None, None, problem, event.start_mark)
        return super().compose_node(parent, index)


def _untagged(loader: _Loader, _: str, node: yaml.Node) -> object:
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
        documents = list(yaml.load_all(text, Loader=_Loader))
    except (yaml.YAMLError, RecursionError, ValueError):
        return []
    return [pose for document in documents for pose in document_poses(document, source)]

"""Nodes of a calibration file by their dotted names, and the keys that say which node is what."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path
from typing import Literal, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from exposight.errors import AmbiguousError, FormatError, InputError, MissingFileError, did_you_mean
from exposight.files import parsing
from exposight.geometry.calibrations.calibration_syntax import parse_tree
from exposight.geometry.calibrations.printed_values import (
    LARGEST_BYTES,
    Tree,
    as_numbers,
)

Node: TypeAlias = NDArray[np.float64] | float | str

_MOST_SHOWN = 24
"""Nodes of a file that a message lists."""

_MOST_NODES = 10_000
"""Nodes of a file, whose names are compared with each other."""


@dataclass(frozen=True, kw_only=True)
class CalibrationNodes:
    """What a calibration file holds: arrays of float64, numbers, text.

    Parameters
    ----------
    path : Path
        The file.
    nodes : mapping of str to ndarray, float or str
        By name; maps within maps become ``outer.inner``, entries of lists ``outer.0``.
    """

    path: Path
    nodes: Mapping[str, Node]

    def matrix(self, key: str, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
        """Return a node as an array.

        Parameters
        ----------
        key : str
            The node's name.
        shape : tuple of int, optional
            The shape it must have; lists of as many numbers are taken row by row.

        Raises
        ------
        FormatError
            If the node is missing, is not numbers, or has another shape.
        """
        node = self.node(key)
        if isinstance(node, str):
            msg = f"{self.path}: node '{key}' must be numbers, got the text {node!r}"
            raise FormatError(msg)
        array = np.asarray(node, dtype=np.float64)
        if shape is None or array.shape == shape:
            return array
        if array.size == int(np.prod(shape)) and max(array.shape, default=1) == array.size:
            return array.reshape(shape)
        expected = "×".join(map(str, shape))
        msg = (
            f"{self.path}: node '{key}' must be {expected} or {int(np.prod(shape))} numbers, got "
            f"shape {array.shape}"
        )
        raise FormatError(msg)

    def whole_numbers(self, key: str, count: int) -> list[int]:
        """Return a node that is so many integers; errors as for `matrix`."""
        numbers = self.matrix(key).reshape(-1).tolist()
        if len(numbers) != count:
            expected = "one number" if count == 1 else f"{count} numbers"
            msg = f"{self.path}: node '{key}' must be {expected}, got {len(numbers)}"
            raise FormatError(msg)
        for number in numbers:
            if not number.is_integer():
                msg = f"{self.path}: node '{key}' must be whole, got {number}"
                raise FormatError(msg)
        return [int(number) for number in numbers]

    def node(self, key: str) -> Node:
        """Return a node.

        Raises
        ------
        FormatError
            If there is none of this name.
        """
        if key not in self.nodes:
            msg = f"{self.path}: no node '{key}'{did_you_mean(key, self.nodes)}; {self.listed()}"
            raise FormatError(msg)
        return self.nodes[key]

    def listed(self) -> str:
        """Return the nodes with their shapes, for messages."""
        names = [
            f"{name} ({'×'.join(map(str, node.shape))})" if isinstance(node, np.ndarray) else name
            for name, node in self.nodes.items()
        ]
        more = f", … {len(names) - _MOST_SHOWN} more" if len(names) > _MOST_SHOWN else ""
        return f"the file has {', '.join(names[:_MOST_SHOWN])}{more}"

    def under(self, group: str) -> "CalibrationNodes":
        """Return the nodes of one group, by their names within it."""
        if not group:
            return self
        start = f"{group}."
        inner = {n.removeprefix(start): v for n, v in self.nodes.items() if n.startswith(start)}
        return CalibrationNodes(path=self.path, nodes=inner)


def read_calibration_nodes(path: str | Path) -> CalibrationNodes:
    """Read the nodes of a calibration file, whatever program wrote it.

    Parameters
    ----------
    path : path
        OpenCV YAML, XML or JSON (with or without a ``%YAML:`` line); plain YAML, of which the first
        document is read; JSON; text under headings, as ``name=value`` or as numbers alone; NumPy's
        .npz without objects; MATLAB's .mat up to version 7, of structures.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it cannot be parsed, holds nothing, or is larger than any calibration.
    """
    path = Path(path)
    if not path.is_file():
        msg = f"{path}: no such calibration file"
        raise MissingFileError(msg)
    expected = "expected a calibration as OpenCV, ROS, MATLAB or a scanner's program writes it"
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
        with parsing("it", "calibration"), np.errstate(all="ignore"):
            tree = parse_tree(data, path.suffix.lower())
            nodes = dict(islice(_walk(tree, ""), _MOST_NODES + 1))
    except FormatError as error:
        msg = f"{path}: not a calibration file that can be read ({error}); {expected}"
        raise FormatError(msg) from error
    except OSError as error:
        msg = f"{path}: {error.strerror or error}"
        raise FormatError(msg) from error
    if not nodes or len(nodes) > _MOST_NODES:
        found = f"more than {_MOST_NODES} nodes" if nodes else "no node"
        msg = f"{path}: {expected}, found {found} in it"
        raise FormatError(msg)
    return CalibrationNodes(path=path, nodes=nodes)


def _walk(tree: Tree, name: str) -> Iterator[tuple[str, Node]]:
    start = f"{name}." if name else ""
    if isinstance(tree, dict):
        for key, each in tree.items():
            yield from _walk(each, f"{start}{key}")
    elif isinstance(tree, list):
        numbers = as_numbers(tree)
        if numbers is not None:
            yield name, numbers
        elif any(isinstance(each, dict) for each in tree):
            for index, each in enumerate(tree):
                yield from _walk(each, f"{start}{index}")
        else:
            yield name, "a list with more in it than numbers"
    else:
        yield name, tree


Direction = Literal["projector_from_camera", "camera_from_projector",
                    "second_from_first", "first_from_second"]  # fmt: skip
NONE = "none"
"""In place of coefficients' node: this lens has no distortion."""


@dataclass(frozen=True, kw_only=True)
class CalibrationKeys:
    """Names of the nodes in a calibration file; what is None is recognised by its shape.

    Parameters
    ----------
    camera_matrix, camera_distortion : str, optional
        Of the camera, or the first of two. Distortion ``none`` says that the lens has none.
    projector_matrix, projector_distortion : str, optional
        Of the projector.
    second_matrix, second_distortion : str, optional
        Of the second camera.
    rotation, translation : str, optional
        Of the transform between both; 3×3 and 3 numbers, mm.
    pose : str, optional
        The same as one node of 4×4 or 3×4 numbers.
    direction : str, optional
        What the transform takes points from and to: ``projector_from_camera`` or
        ``second_from_first`` (X₂ = R·X₁ + T, OpenCV's), or the inverse of one.
    camera_size, projector_size, second_size : str, optional
        One node of two numbers, or two nodes as ``WIDTH+HEIGHT``.

    Raises
    ------
    InputError
        If the direction is none of those, or a projector and a second camera are named.
    """

    camera_matrix: str | None = None
    camera_distortion: str | None = None
    projector_matrix: str | None = None
    projector_distortion: str | None = None
    second_matrix: str | None = None
    second_distortion: str | None = None
    rotation: str | None = None
    translation: str | None = None
    pose: str | None = None
    direction: Direction | None = None
    camera_size: str | None = None
    projector_size: str | None = None
    second_size: str | None = None

    def __post_init__(self) -> None:
        if self.direction is not None and self.direction not in get_args(Direction):
            known = get_args(Direction)
            msg = f"direction must be {' or '.join(known)}, got {self.direction!r}"
            raise InputError(msg + did_you_mean(self.direction, known))
        if self.projector_matrix and self.second_matrix:
            msg = (
                "keys name a projector_matrix and a second_matrix; one calibration has one of both"
            )
            raise InputError(msg)
        if self.pose and (self.rotation or self.translation):
            msg = "keys name a pose, and rotation or translation; give one or the other"
            raise InputError(msg)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the keys of a text such as ``camera_matrix=Kleft,rotation=R``.

        Raises
        ------
        InputError
            If it is no such list, or an entry is unknown or there twice.
        """
        known = [entry.name for entry in fields(cls)]
        # Names of nodes may hold commas and blanks; entries begin with a word and "=".
        parts = [part.strip() for part in re.split(r",(?=\s*\w+\s*=)", text) if part.strip()]
        given: dict[str, str] = {}
        for part in parts:
            name, equals, node = (each.strip() for each in part.partition("="))
            if not equals or not node or name not in known:
                msg = (
                    f"keys are written as ENTRY=NODE,…, ENTRY one of {', '.join(known)}, got "
                    f"{part!r}{did_you_mean(name, known)}"
                )
                raise InputError(msg)
            if name in given:
                msg = f"the keys say {name} twice"
                raise InputError(msg)
            given[name] = node
        return cls(**given)  # type: ignore[arg-type]  # the direction is checked above


def ask_which(
    file: CalibrationNodes, question: str, entry: str, answers: Sequence[str]
) -> AmbiguousError | FormatError:
    """Return the error that asks which node is meant, with the ``--keys`` that answer it.

    `entry` is the key that answers; empty where the answers hold theirs. Where no node fits, it is
    an error of the file.
    """
    if not answers:
        return FormatError(f"{file.path}: {question} {file.listed()}")
    keys = [f"--keys {entry}={each}" if entry else f"--keys {each}" for each in answers[:8]]
    quoted = [f"--keys '{each[7:]}'" if " " in each[7:] else each for each in keys]
    msg = (
        f"{file.path}: {question} Say which it is: {' or '.join(quoted)} (in Python "
        "keys=CalibrationKeys(…))"
    )
    return AmbiguousError(msg, tuple(keys))

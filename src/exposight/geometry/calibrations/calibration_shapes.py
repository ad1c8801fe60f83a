"""What the nodes of a calibration are, by their shapes: matrices, coefficients, sizes, poses.

A camera matrix is 3×3 with focal lengths in px and a last row of 0, 0, 1; a rotation is
orthonormal; 4, 5, 8, 12 or 14 numbers in a row are lens coefficients where their name says so.
Names matter where shapes do not tell; what two nodes could be is left to the caller to ask.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from exposight.geometry.calibrations.calibration_names import (
    CAMERA,
    DISTORTION,
    NOT_OF_IT,
    PROJECTOR,
    group_of,
    shared_maps,
    told_apart,
    words,
)
from exposight.geometry.calibrations.calibration_nodes import Node

_Array = NDArray[np.float64]

_LEAST_FOCAL_PX = 20.0
_LENGTHS = {4, 5, 8, 12, 14}
_LOOSE = 1e-2
"""Of RᵀR − I: what is nearly a rotation was meant to be one, and is refused as such."""
_ROTATION_NAMES = {"r", "rp", "rot", "rotation", "roration", "rmat", "rotation_matrix"}
_TRANSLATION_NAMES = {"t", "tp", "trans", "translation", "tvec", "translation_mm"}
_VECTORS = frozenset({"rvec", "om", "rodrigues"})
_NO_TRANSLATION = frozenset(
    {"rvec", "rvecs", "tvecs", "om", "omc", "euler", "angles", "rpy", "rotation", "vectors"}
    | {"color", "colour", "white", "gain", "size", "shape", "resolution", "imu"}
)  # fmt: skip
_ELSEWHERE = frozenset({"imu", "world", "base", "hand", "flange", "robot", "tool", "board"})
_NO_SIZE = frozenset({"board", "chess", "chessboard", "checkerboard", "square", "marker", "grid",
                      "roi", "binning", "win", "window", "pattern", "pixel", "sensor", "cell",
                      "mm", "step"})  # fmt: skip
_WIDE = {"width", "breite", "w", "cols", "columns", "nx", "x"}
_HIGH = {"height", "hoehe", "h", "rows", "ny", "y"}
_SIZE_NAMES = frozenset({"size", "resolution", "res", "dims", "dimensions"})
LEAST_PX, _LARGEST_PX = 16, 100_000


@dataclass(frozen=True, kw_only=True)
class SizeNodes:
    """An image's size in a file: width and height in px, and where they stand.

    Parameters
    ----------
    names : str
        The nodes, for messages.
    group : str
        The map that they stand in.
    size : (int, int)
        Width and height.
    turned : bool or None
        Of a pair of numbers: True where its name says (height, width); None of two nodes.
    """

    names: str
    group: str
    size: tuple[int, int]
    turned: bool | None = None


def camera_matrices(nodes: Mapping[str, Node]) -> dict[str, _Array]:
    """Return the 3×3 camera matrices, those of one device once."""
    found: dict[str, _Array] = {}
    derived: dict[str, _Array] = {}
    for name, node in nodes.items():
        matrix = square(node, 3)
        if matrix is None or not is_camera_matrix(matrix):
            continue
        if any(
            shared_maps(name, other) > 0
            and np.array_equal(matrix, known)
            and told_apart(name, other).roles is None
            for other, known in found.items()
        ):
            continue
        (derived if words(name) & NOT_OF_IT else found)[name] = matrix
    return found or derived or projections(nodes)


def derived_matrices(nodes: Mapping[str, Node]) -> list[str]:
    """Return the names of camera matrices of undistorted images: newcameramtx."""
    matrices = {name: square(node, 3) for name, node in nodes.items() if words(name) & NOT_OF_IT}
    return [name for name, each in matrices.items() if each is not None and is_camera_matrix(each)]


def projections(nodes: Mapping[str, Node]) -> dict[str, _Array]:
    """Return the camera matrices of 3×4 projections, which are of rectified images."""
    found: dict[str, _Array] = {}
    for name, node in nodes.items():
        if isinstance(node, np.ndarray) and node.size == 12 and {3, 12} & set(node.shape):
            matrix = node.reshape(3, 4)[:, :3]
            if is_camera_matrix(matrix):
                found[name] = matrix
    return found


def is_camera_matrix(matrix: _Array) -> bool:
    """Tell whether 3×3 numbers are a camera matrix in px."""
    fx, fy = matrix[0, 0], matrix[1, 1]
    if not np.isfinite(matrix).all() or min(fx, fy) < _LEAST_FOCAL_PX:
        return False
    lower = np.abs([matrix[1, 0], matrix[2, 0], matrix[2, 1], matrix[2, 2] - 1.0]).max()
    return bool(lower < 1e-6 and abs(matrix[0, 1]) < 0.05 * fx and 0.2 < fx / fy < 5.0)


def square(node: Node, size: int) -> _Array | None:
    """Return a node of size × size numbers as a matrix; None where it has others."""
    if not isinstance(node, np.ndarray) or node.size != size * size:
        return None
    if node.shape == (size, size) or max(node.shape) == node.size:
        return node.reshape(size, size)
    return None


def coefficient_vectors(nodes: Mapping[str, Node]) -> tuple[dict[str, _Array], dict[str, _Array]]:
    """Return what are lens coefficients by name, and what may be some by length alone."""
    named, others = dict[str, _Array](), dict[str, _Array]()
    for name, node in nodes.items():
        if not isinstance(node, np.ndarray) or (node.size and max(node.shape) != node.size):
            continue
        told = words(name.rpartition(".")[2])
        if told & NOT_OF_IT or told & {"quaternion", "quat", "orientation", "plane", "roi"}:
            continue
        unnamed = re.fullmatch(r"matrix\d*", name) is not None  # of a file of numbers alone
        if (told & DISTORTION and node.size <= 14 and node.size != 9) or (
            unnamed and node.size in _LENGTHS
        ):
            named[name] = node.reshape(-1)
        elif node.size in _LENGTHS:
            others[name] = node.reshape(-1)
    return named, others


def sizes(nodes: Mapping[str, Node]) -> list[SizeNodes]:
    """Return the image sizes in a file."""
    found: list[SizeNodes] = []
    for name, node in nodes.items():
        group, _, leaf = name.rpartition(".")
        told = words(leaf)
        if told & _NO_SIZE or words(group) & _NO_SIZE:
            continue
        if isinstance(node, float) and (wide := told & _WIDE) and _is_length(node):
            if wide == {"x"} and "res" not in told:
                continue
            for other, high in nodes.items():
                partner = words(other.rpartition(".")[2])
                if (
                    group_of(other) == group
                    and isinstance(high, float)
                    and _is_length(high)
                    and partner & _HIGH
                    and told - _WIDE == partner - _HIGH
                ):
                    size = (int(node), int(high))
                    found.append(SizeNodes(names=f"{name}, {other}", group=group, size=size))
        elif isinstance(node, np.ndarray) and node.size == 2:
            pair = node.reshape(-1)
            if all(map(_is_length, pair)) and told & (_SIZE_NAMES | {"shape"}):
                turned = "shape" in told
                first, second = (int(each) for each in pair)
                size = (second, first) if turned else (first, second)
                found.append(SizeNodes(names=name, group=group, size=size, turned=turned))
    return found


def _is_length(number: float) -> bool:
    return bool(np.isfinite(number) and number == int(number) and LEAST_PX <= number <= _LARGEST_PX)


def size_role(size: SizeNodes) -> str:
    """Return of what a size is, by its name: projector, camera, or nothing."""
    told = words(size.names)
    if told & (PROJECTOR | {"screen", "display"}):
        return "projector"
    return "camera" if told & CAMERA else ""


# -- poses --------------------------------------------------------------------------------------


def rotations(nodes: Mapping[str, Node]) -> dict[str, _Array]:
    """Return the rotations that may lead from one device to the other, the likeliest name alone."""
    found: dict[str, _Array] = {}
    for name, node in nodes.items():
        matrix = square(node, 3)
        if matrix is None or words(name) & (NOT_OF_IT | _ELSEWHERE) or is_camera_matrix(matrix):
            continue
        if _is_nearly_rotation(matrix):
            found[name] = matrix
    if not found:
        for name, node in nodes.items():
            if words(name) & _VECTORS and isinstance(node, np.ndarray) and node.size == 3:
                found[name] = Rotation.from_rotvec(node.reshape(-1)).as_matrix()
    if not found:  # meant to be one, and refused as none
        for name, node in nodes.items():
            matrix = square(node, 3)
            if matrix is not None and name.rpartition(".")[2].lower() in _ROTATION_NAMES:
                found[name] = matrix
    return _likeliest(found, _ROTATION_NAMES)


def _is_nearly_rotation(matrix: _Array) -> bool:
    if not np.all(np.abs(matrix) < 2.0):  # nor NaN
        return False
    return bool(np.abs(matrix.T @ matrix - np.eye(3)).max() < _LOOSE)


def translations(nodes: Mapping[str, Node]) -> dict[str, _Array]:
    """Return the translations that may lead from one device to the other, as `rotations`."""
    found: dict[str, _Array] = {}
    for name, node in nodes.items():
        if not isinstance(node, np.ndarray) or node.size != 3 or max(node.shape) != 3:
            continue
        told = words(name)
        leaf = words(name.rpartition(".")[2])
        if told & (NOT_OF_IT | _ELSEWHERE | _NO_TRANSLATION) or leaf & (DISTORTION - {"d", "k"}):
            continue
        if leaf & {"k", "d"} and not leaf & {"t"}:
            continue
        found[name] = node.reshape(3)
    return _likeliest(found, _TRANSLATION_NAMES)


def motions(nodes: Mapping[str, Node]) -> dict[str, _Array]:
    """Return the 4×4 and 3×4 rigid motions."""
    found: dict[str, _Array] = {}
    for name, node in nodes.items():
        if not isinstance(node, np.ndarray) or node.size not in {12, 16}:
            continue
        if words(name) & (NOT_OF_IT | _ELSEWHERE):
            continue
        rows = node.size // 4
        if node.shape != (rows, 4) and max(node.shape) != node.size:
            continue
        matrix = node.reshape(rows, 4)
        if _is_nearly_rotation(matrix[:3, :3]) and matrix[:3, 3].any():
            found[name] = matrix
    return found


def _likeliest(found: dict[str, _Array], usual: set[str]) -> dict[str, _Array]:
    """Return those with a usual name where there are several; those that differ from nothing."""
    if len(found) > 1:
        plain = {n: m for n, m in found.items() if n.rpartition(".")[2].lower() in usual}
        found = plain or found
    if len(found) > 1:  # the first device's own, from itself: no turn, no way
        away = {
            n: m
            for n, m in found.items()
            if not (np.array_equal(m, np.eye(3)) if m.ndim == 2 else not m.any())
        }
        found = away or found
    return found

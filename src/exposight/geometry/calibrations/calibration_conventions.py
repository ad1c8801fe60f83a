"""Programs that write a camera in other terms than a matrix and OpenCV's coefficients.

Each is brought into those terms: focal lengths and principal point as named numbers (Zivid,
RealSense, Mech-Eye, rc_visard), MATLAB's row vectors and pixels counted from 1, Ensenso's columns,
Kalibr's four numbers. What was done is said. Sources: MATLAB `stereoParametersToOpenCV` (1 is
subtracted from the principal point), Kalibr's yaml-formats (``T_cn_cnm1`` takes points of camera
n − 1 to camera n, in m), Roboception's rc_visard_driver (``camera.A``, ``camera.k1``).
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError
from exposight.geometry.calibrations.calibration_names import group_of, words
from exposight.geometry.calibrations.calibration_nodes import CalibrationNodes, Node

_NAMED = {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy", "ppx": "cx", "ppy": "cy",
          "focallengthx": "fx", "focallengthy": "fy", "principalpointx": "cx",
          "principalpointy": "cy"}  # fmt: skip
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_PART_OF_LENS = re.compile(r"(?<![a-z])(?:radial|tangential)[a-z]*[_\-. ]", re.IGNORECASE)
_MM_PER = {"m": 1000.0, "meter": 1000.0, "meters": 1000.0, "metre": 1000.0, "metres": 1000.0,
           "cm": 10.0, "centimeters": 10.0, "mm": 1.0, "millimeter": 1.0, "millimeters": 1.0,
           "in": 25.4, "inch": 25.4, "inches": 25.4}  # fmt: skip
_FISHEYE = re.compile(r"equi|fisheye|fish_eye|kannala|omni|mei|ftheta|kb4|ds$|eucm", re.IGNORECASE)
_MODEL_NAMES = {"distortionmodel", "cameramodel", "model", "lensmodel", "distortion", "type"}


def in_opencv_terms(file: CalibrationNodes) -> tuple[CalibrationNodes, list[str]]:
    """Return the nodes with matrices and coefficients as OpenCV has them, and what was done.

    Raises
    ------
    FormatError
        If a lens is of a model that no pinhole camera has, or a coefficient is missing.
    """
    _check_model(file)
    nodes, remarks = dict(file.nodes), list[str]()
    for convert in (
        _matlab,
        _ensenso,
        _kalibr,
        _realsense,
        _parted,
        _named_numbers,
        _pairs_of_numbers,
    ):
        remarks += convert(nodes)
    return replace(file, nodes=nodes), remarks


def fisheye(path: object, model: str) -> FormatError:
    """Return the error for a lens that bends too much for a pinhole camera."""
    return FormatError(
        f"{path}: distortion model '{model}' is not a pinhole lens's; expected 'plumb_bob' or "
        "'rational_polynomial': calibrate with one of these, or undistort the images and give the "
        "new camera matrix without distortion"
    )


def unit_mm(file: CalibrationNodes) -> tuple[float, str] | None:
    """Return how many mm the file's unit of length has, and its name; None where it says none."""
    for name, node in file.nodes.items():
        told = words(name.rpartition(".")[2])
        if isinstance(node, str) and told & {"unit", "units"} and node.lower() in _MM_PER:
            return _MM_PER[node.lower()], node
    return None


def _check_model(file: CalibrationNodes) -> None:
    for name, node in file.nodes.items():
        leaf = re.sub("[^a-z]", "", name.rpartition(".")[2].lower())
        if "fisheye" in leaf and str(node).lower() not in {"0.0", "false", "no", ""}:
            raise fisheye(file.path, "fisheye")
        if leaf in {"mappingcoefficients", "xi"}:
            raise fisheye(file.path, leaf)
        if not isinstance(node, str) or leaf not in _MODEL_NAMES:
            continue
        if _FISHEYE.search(node) and "pinhole" not in node.lower():
            raise fisheye(file.path, node)
        inverse = "inverse" in node.lower() or "modified" in node.lower()
        if inverse and leaf != "type" and _any_coefficient(file.nodes, group_of(name)):
            msg = (
                f"{file.path}: the lens model '{node}' is none of OpenCV's; undistort the images, "
                "or calibrate with OpenCV's model"
            )
            raise FormatError(msg)


def _any_coefficient(nodes: Mapping[str, Node], group: str) -> bool:
    return any(
        np.any(node)
        for name, node in nodes.items()
        if not isinstance(node, str) and group_of(name) == group and "coeffs" in words(name)
    )


# -- numbers by name ----------------------------------------------------------------------------


def _named_numbers(nodes: dict[str, Node]) -> Iterator[str]:
    """Make matrices of fx, fy, cx, cy, and coefficients of k1, k2, p1 and so on."""
    for (group, stem), found in _gathered(nodes, _NAMED).items():
        if set(found) == {"fx", "fy", "cx", "cy"}:
            name = _joined(group, f"{stem}fx, {stem}fy, {stem}cx, {stem}cy")
            nodes[name] = _matrix(found["fx"], found["fy"], found["cx"], found["cy"])
    known = {each: each for each in _COEFFICIENTS}
    for (group, stem), found in _gathered(nodes, known).items():
        if "k1" in found:
            last = max(_COEFFICIENTS.index(each) for each in found)
            count = 8 if last > 4 else 5 if last == 4 else 4
            name = _joined(group, f"{stem}distortion k1, k2, …")
            nodes[name] = np.array([found.get(each, 0.0) for each in _COEFFICIENTS[:count]])
    return iter(())


def _parted(nodes: dict[str, Node]) -> Iterator[str]:
    """Make coefficients of k1, k2, k3, … named radial, and p1, p2 named tangential."""
    for name, node in list(nodes.items()):
        group, _, leaf = name.rpartition(".")
        if not isinstance(node, np.ndarray) or not _PART_OF_LENS.match(f"{leaf}_"):
            continue
        if leaf.lower().startswith("radial") and node.size in {2, 3, 6}:
            across = _joined(group, f"{'T' if leaf[0] == 'R' else 't'}angential{leaf[6:]}")
            other = nodes.pop(across, None)
            p = [0.0, 0.0] if other is None else _array(other, (2,)).tolist()
            k = _array(nodes.pop(name)).tolist()
            nodes[_joined(group, "distortion radial, tangential")] = np.array([*k[:2], *p, *k[2:]])
            yield f"{name} are k1, k2, …" + ("" if other is None else f", {across} are p1, p2")


def _gathered(
    nodes: Mapping[str, Node], known: Mapping[str, str]
) -> dict[tuple[str, str], dict[str, float]]:
    """Return named numbers by the map and the start of the name that they share."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    pattern = re.compile(rf"(|.*[_\-. ])({'|'.join(known)})")
    for name, node in nodes.items():
        # radial.k1 and tangential.p1 are of one lens
        group, _, leaf = _PART_OF_LENS.sub("", name).rpartition(".")
        bare = re.sub(r"(?<=[a-z])_?(?=(x|y)$)|(?<=focal)_|(?<=principal)_", "", leaf.lower())
        for spelled in (leaf.lower(), bare):
            match = pattern.fullmatch(spelled)
            if match is not None and isinstance(node, float):
                stem = leaf[: len(match[1])]
                found.setdefault((group, stem), {})[known[match[2]]] = node
                break
    return found


def _pairs_of_numbers(nodes: dict[str, Node]) -> Iterator[str]:
    """Make matrices of two focal lengths and two coordinates: Bouguet's fc and cc."""
    for name, node in list(nodes.items()):
        group, _, leaf = name.rpartition(".")
        start = re.fullmatch(r"(fc|focal_?length)(.*)", leaf, re.IGNORECASE)
        if start is None or not isinstance(node, np.ndarray) or node.size != 2:
            continue
        for other in ("cc", "principalpoint", "principal_point", "PrincipalPoint"):
            centre = nodes.get(_joined(group, f"{other}{start[2]}"))
            if not isinstance(centre, np.ndarray) or centre.size != 2:
                continue
            (fx, fy), (cx, cy) = node.reshape(-1).tolist(), centre.reshape(-1).tolist()
            matrix = _matrix(fx, fy, cx, cy)
            if not any(
                isinstance(each, np.ndarray)
                and each.shape == (3, 3)
                and np.allclose(np.diag(each), np.diag(matrix))
                for each in nodes.values()
            ):
                nodes[_joined(group, f"{leaf}, {other}{start[2]}")] = matrix
    return iter(())


def _matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _joined(group: str, leaf: str) -> str:
    return f"{group}.{leaf}" if group else leaf


# -- MATLAB -------------------------------------------------------------------------------------


def _matlab(nodes: dict[str, Node]) -> Iterator[str]:
    leaves = _by_leaf(nodes)
    groups = {group_of(name) for leaf in ("IntrinsicMatrix", "RadialDistortion", "PrincipalPoint")
              for name in leaves.get(leaf, ())}  # fmt: skip
    for group in sorted(groups):
        _matlab_camera(nodes, group)
    if groups:
        yield (
            "MATLAB's matrices are turned into OpenCV's, and 1 px is taken from the principal "
            "point, which MATLAB counts from 1"
        )
    for name in leaves.get("RotationOfCamera2", ()):
        nodes[name] = _array(nodes[name], (3, 3)).T
        yield "RotationOfCamera2, of MATLAB's row vectors, is transposed"
    for name in [*leaves.get("RotationMatrices", ()), *leaves.get("TranslationVectors", ())]:
        nodes.pop(name)


def _matlab_camera(nodes: dict[str, Node], group: str) -> None:
    def pop(leaf: str) -> Node | None:
        return nodes.pop(_joined(group, leaf), None)

    transposed, matrix = pop("IntrinsicMatrix"), pop("K")
    focal, centre, skew = pop("FocalLength"), pop("PrincipalPoint"), pop("Skew")
    made: NDArray[np.float64] | None = None
    if transposed is not None:
        made = _array(transposed, (3, 3))
        made = made.T.copy() if made[2, :2].any() or not made[:2, 2].any() else made.copy()
    elif matrix is not None:
        made = _array(matrix, (3, 3)).copy()
    elif focal is not None and centre is not None:
        (fx, fy), (cx, cy) = (_array(each, (2,)).tolist() for each in (focal, centre))
        made = _matrix(fx, fy, cx, cy)
        made[0, 1] = skew if isinstance(skew, float) else 0.0
    if made is not None:
        made[:2, 2] -= 1.0
        nodes[_joined(group, "IntrinsicMatrix" if transposed is not None else "K")] = made
    radial, tangential = pop("RadialDistortion"), pop("TangentialDistortion")
    if radial is not None:
        k = [*_array(radial).tolist(), 0.0, 0.0][:3]
        p = [0.0, 0.0] if tangential is None else _array(tangential, (2,)).tolist()
        nodes[_joined(group, "Distortion")] = np.array([k[0], k[1], *p, k[2]])
    size = nodes.get(_joined(group, "ImageSize"))
    if isinstance(size, np.ndarray) and size.size == 2:
        nodes.pop(_joined(group, "ImageSize"))
        height, width = size.reshape(-1).tolist()
        nodes[_joined(group, "ImageSize width")] = width
        nodes[_joined(group, "ImageSize height")] = height


def _array(node: Node, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    if isinstance(node, str):
        msg = f"expected numbers in MATLAB's parameters, got {node!r}"
        raise FormatError(msg)
    array = np.asarray(node, dtype=np.float64)
    if shape is None:
        return array.reshape(-1)
    if array.size != int(np.prod(shape)):
        msg = f"expected {shape} numbers in MATLAB's parameters, got {array.shape}"
        raise FormatError(msg)
    return array.reshape(shape)


# -- Ensenso, Kalibr ----------------------------------------------------------------------------


def _ensenso(nodes: dict[str, Node]) -> Iterator[str]:
    """Ensenso's tree holds matrices column by column, beneath Monocular and Dynamic.Stereo."""
    turned = False
    for name, node in list(nodes.items()):
        path = name.lower().split(".")
        of_ensenso = bool({"monocular", "stereo"} & set(path[:-1]))
        if path[-1] != "camera" or not of_ensenso or not isinstance(node, np.ndarray):
            continue
        if node.shape == (3, 3) and not node[:2, 2].any() and node[2, :2].any():
            nodes[name], turned = node.T.copy(), True
    if turned:
        yield "Ensenso's matrices are read column by column"


def _kalibr(nodes: dict[str, Node]) -> Iterator[str]:
    """Kalibr's camera chain: intrinsics [fx, fy, cx, cy], T_cn_cnm1 in m."""
    leaves = _by_leaf(nodes)
    for name in leaves.get("intrinsics", ()):
        node = nodes[name]
        if isinstance(node, np.ndarray) and node.size == 4 and node.ndim == 1:
            nodes[name] = _matrix(*node.tolist())
            yield f"{name} are fx, fy, cx, cy"
    for name in leaves.get("T_cn_cnm1", ()):
        node = nodes[name]
        if isinstance(node, np.ndarray) and node.size == 16:
            matrix = node.reshape(4, 4).copy()
            matrix[:3, 3] *= 1000.0
            nodes[name] = matrix
            yield "T_cn_cnm1 is in m, as Kalibr writes it"


def _realsense(nodes: dict[str, Node]) -> Iterator[str]:
    """RealSense's extrinsics hold rotations column by column, and translations in m."""
    leaves = _by_leaf(nodes)
    if not {"ppx", "coeffs"} <= leaves.keys():
        return
    for name in leaves.get("rotation", ()):
        node = nodes[name]
        other = _joined(group_of(name), "translation")
        way = nodes.get(other)
        if isinstance(node, np.ndarray) and node.shape == (9,) and isinstance(way, np.ndarray):
            nodes[name] = node.reshape(3, 3).T.copy()
            nodes[other] = 1000.0 * way
            yield "RealSense's rotation is read column by column, its translation in m"


def _by_leaf(names: Iterable[str]) -> dict[str, list[str]]:
    leaves: dict[str, list[str]] = {}
    for name in names:
        leaves.setdefault(name.rpartition(".")[2], []).append(name)
    return leaves

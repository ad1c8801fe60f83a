"""Calibrations as programs write them, and poses as robots do."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.io import savemat
from tests.fuzz.clouds import NPY_FAULTS, Fault, count_in
from tests.fuzz.formats import Format, Sample
from tests.fuzz.text_files import is_plain

from exposight.geometry import RigidTransform, read_calibration, read_named_poses
from exposight.geometry.calibrations.calibration import Calibration

K = np.array([[2210.5, 0, 811.25], [0, 2212.25, 622.5], [0, 0, 1]])
D = np.array([-0.0812, 0.1334, 0.0004, -0.0011, 0.025])
KP = np.array([[1890.25, 0, 634.5], [0, 1893.5, 752.75], [0, 0, 1]])
DP = np.array([0.012, -0.08, 0.0002, 0.0005, 0.0])
R = RigidTransform.from_fanuc_wpr((0, 0, 0), 0.0, 14.0, 0.0).rotation
T = np.array([-118.5, 3.25, 21.5])
SIZES = {"image_width": 1624, "image_height": 1240}
RIG = {"cam_K": K, "cam_kc": D, "proj_K": KP, "proj_kc": DP, "R": R, "T": T[:, None]}
RIG_SIZES = {"cam_width": 1624, "cam_height": 1240, "proj_width": 1280, "proj_height": 800}
LARGEST_PX = 100_000
FARTHEST_MM = 1e6


def _lists(value: Any) -> Any:
    """Return a value with lists for arrays."""
    if isinstance(value, Mapping):
        return {key: _lists(each) for key, each in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def _read(path: Path) -> Calibration:
    return read_calibration(path, image_size=None, images="raw", second=None)


def _samples(contents: Mapping[str, str | bytes]) -> Callable[[Path], list[Sample]]:
    def samples(folder: Path) -> list[Sample]:
        for name, content in contents.items():
            data = content if isinstance(content, bytes) else content.encode()
            (folder / name).write_bytes(data)
        return [Sample(folder / name) for name in contents]

    return samples


# -- what must hold -------------------------------------------------------------------------------


def _wrong_motion(motion: RigidTransform) -> str:
    turn, way = motion.rotation, motion.translation_mm
    if not (np.isfinite(turn).all() and np.isfinite(way).all()):
        return "a pose is not finite"
    if np.abs(turn.T @ turn - np.eye(3)).max() > 1e-9 or np.linalg.det(turn) < 0:
        return "a rotation is none"
    return "a pose is a kilometre away" if np.abs(way).max() > FARTHEST_MM else ""


def _wrong_calibration(found: Calibration) -> str:
    """Say what is wrong with a calibration."""
    cameras = [each for each in (found.camera, found.second, found.projector) if each is not None]
    if (found.transform is None) != (len(cameras) == 1):
        return "cameras and poses do not fit"
    for each in cameras:
        numbers = (each.fx, each.fy, each.cx, each.cy, each.skew, *each.distortion)
        if not all(map(math.isfinite, numbers)) or max(map(abs, numbers)) > 1e9:
            return "a camera's numbers are not finite, or huge"
        if min(each.fx, each.fy) < 1e-6:
            return "a focal length is not positive"
        if not all(type(n) is int and 1 <= n <= LARGEST_PX for n in (each.width, each.height)):
            return f"an image of {each.width} × {each.height}"
        if each.radius_limit <= 0.0:
            return "a lens that reaches no pixel"
    return "" if found.transform is None else _wrong_motion(found.transform)


def _wrong_poses(poses: Mapping[str, RigidTransform]) -> str:
    """Say what is wrong with poses and their names."""
    if not poses:
        return "no poses"
    if not all(name and is_plain(name) and len(name) <= 1000 for name in poses):
        return "a name is empty, endless or has control characters"
    return next(filter(None, map(_wrong_motion, poses.values())), "")


# -- faults of numbers ----------------------------------------------------------------------------


def _number(old: str, *new: str) -> Fault:
    """Return a fault that writes another number for one, wherever that stands by itself."""
    pattern = re.compile(rb"(?<![\w.])" + re.escape(old).encode() + rb"(?![\d])")

    def change(data: bytes, random: Random) -> bytes | None:
        found = list(pattern.finditer(data))
        if not found:
            return None
        one = random.choice(found)
        return data[: one.start()] + random.choice(new).encode() + data[one.end() :]

    return change


def _twice(pattern: bytes, repeated: bytes) -> Fault:
    """Return a fault that has a key twice, with other values."""

    def change(data: bytes, _: Random) -> bytes | None:
        changed = re.sub(pattern, repeated, data, count=1)
        return changed if changed != data else None

    return change


def _missing(*numbers: str) -> Fault:
    """Return a fault that leaves a number of a matrix out, with what separates it."""

    def change(data: bytes, random: Random) -> bytes | None:
        number = re.escape(random.choice(numbers)).encode()
        changed = re.sub(rb"(?<![\d.-])" + number + rb"(?![\d])[ ]*[,;]?", b"", data, count=1)
        return changed if changed != data else None

    return change


_CAMERA_FAULTS: dict[str, Fault] = {
    "focal length that is none": _number("2210.5", "0", "-2210.5", "nan", "1e300", "inf"),
    "distortion that is none": _number("0.1334", "nan", "1e999", "1e300"),
    "rotation that is none": _number(repr(float(R[0, 0])), "-0.97", "5.5", "nan", "1e300"),
    "size that is none": _number("1624", "-1624", "0", "1624.5", "1e300", "nan", "100000000"),
    "a value missing": _missing("2210.5", "2212.25", "622.5"),
}

# -- calibrations ---------------------------------------------------------------------------------


def _opencv(nodes: Mapping[str, Any]) -> str:
    """Write nodes as OpenCV writes YAML."""
    lines = ["%YAML:1.0", "---"]
    for name, value in nodes.items():
        if np.ndim(value) == 0:
            lines.append(f"{name}: {value}")
            continue
        rows = np.atleast_2d(value)
        data = ", ".join(repr(float(x)) for x in rows.ravel())
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows.shape[0]}"]
        lines += [f"   cols: {rows.shape[1]}", "   dt: d", f"   data: [ {data} ]"]
    return "\n".join(lines) + "\n"


def _xml(nodes: Mapping[str, Any]) -> str:
    """Write nodes as OpenCV writes XML."""
    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    for name, value in nodes.items():
        if np.ndim(value) == 0:
            lines.append(f"<{name}>{value}</{name}>")
            continue
        rows = np.atleast_2d(value)
        data = " ".join(repr(float(x)) for x in rows.ravel())
        lines += [
            f'<{name} type_id="opencv-matrix">',
            f"<rows>{rows.shape[0]}</rows><cols>{rows.shape[1]}</cols><dt>d</dt>",
            f"<data>{data}</data></{name}>",
        ]
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _ros(ending: str = "") -> str:
    def matrix(name: str, value: NDArray[np.float64]) -> str:
        rows = np.atleast_2d(value)
        data = ", ".join(map(repr, map(float, rows.ravel())))
        return f"{name}:\n  rows: {rows.shape[0]}\n  cols: {rows.shape[1]}\n  data: [{data}]\n"

    return (
        "image_width: 1624\nimage_height: 1240\ncamera_name: left\n"
        + matrix("camera_matrix", K)
        + "distortion_model: plumb_bob\n"
        + matrix("distortion_coefficients", D)
        + matrix("rectification_matrix", R)
        + matrix("projection_matrix", np.c_[K, np.zeros(3)])
        + ending
    )


_ROS_MESSAGE = (
    "header:\n  frame_id: cam\nheight: 1240\nwidth: 1624\ndistortion_model: plumb_bob\n"
    + "".join(
        f"{name}:\n" + "".join(f"- {float(x)!r}\n" for x in value.ravel())
        for name, value in {"d": D, "k": K, "r": R, "p": np.c_[K, np.zeros(3)]}.items()
    )
    + "binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n"
)


def _rows(matrix: NDArray[np.float64], separator: str = " ") -> str:
    return "\n".join(separator.join(map(repr, map(float, row))) for row in np.atleast_2d(matrix))


_TEXTS = {
    "headings.txt": f"Camera matrix:\n{_rows(K)}\nDistortion coefficients:\n{_rows(D)}\n"
    "width: 1624\nheight: 1240\n",
    "values.txt": "fx = 2210.5\nfy = 2212.25\ncx = 811.25\ncy = 622.5\nk1 = -0.0812\n"
    "k2 = 0.1334\np1 = 0.0004\np2 = -0.0011\nk3 = 0.025\nwidth = 1624\nheight = 1240\n",
    "sections.toml": f"[camera]\nmatrix = {K.tolist()}\ndistortion = {D.tolist()}\n"
    "size = [1624, 1240]\n",
    "ost.ini": f"# oST version 5.0 parameters\n\n[image]\n\nwidth\n1624\n\nheight\n1240\n\n[left]\n"
    f"\ncamera matrix\n{_rows(K)}\n\ndistortion\n{_rows(D)}\n\nrectification\n{_rows(R)}\n\n"
    f"projection\n{_rows(np.c_[K, np.zeros(3)])}\n",
}


def _npz(folder: Path) -> list[Sample]:
    one, rig = folder / "camera.npz", folder / "rig.npz"
    np.savez_compressed(one, mtx=K, dist=D[None], image_size=np.array([1624, 1240]))
    np.savez(rig, **{**RIG, **{name: np.array(size) for name, size in RIG_SIZES.items()}})
    return [Sample(one), Sample(rig)]


def _mat(*, packed: bool) -> bytes:
    one = K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    camera = {
        "IntrinsicMatrix": one.T,
        "RadialDistortion": D[[0, 1, 4]],
        "TangentialDistortion": D[[2, 3]],
        "ImageSize": np.array([1240.0, 1624.0]),
    }
    file = io.BytesIO()
    savemat(file, {"params": camera}, do_compression=packed)
    return file.getvalue()


# -- poses ----------------------------------------------------------------------------------------

POSE = RigidTransform.from_fanuc_wpr((412.5, -123.25, 680.75), 10.0, -20.0, 30.0)
OTHER = RigidTransform.from_fanuc_wpr((12.5, 323.25, 480.75), 100.0, -25.0, 5.0)
X, Y, Z = POSE.translation_mm
_A, _B, _C = POSE.to_kuka_abc()
_Q = POSE.to_abb_quaternion()
_M, _VECTOR = POSE.to_ur_rotation_vector()


def _quaternion(pose: RigidTransform) -> str:
    return ",".join(f"{q:.9f}" for q in pose.to_abb_quaternion())


def _robtarget(name: str, pose: RigidTransform) -> str:
    x, y, z = pose.translation_mm
    far = "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]"
    turn = _quaternion(pose)
    return f"  CONST robtarget {name}:=[[{x},{y},{z}],[{turn}],[0,0,0,0],{far}];\n"


def _fanuc(number: int, pose: RigidTransform) -> str:
    (x, y, z), (w, p, r) = pose.translation_mm, pose.to_fanuc_wpr()
    return (
        f"P[{number}]{{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX =   {x}  mm,\tY =   {y}  mm,\tZ =   {z}  mm,\n"
        f"\tW =   {w:.3f} deg,\tP =   {p:.3f} deg,\tR =   {r:.3f} deg\n}};\n"
    )


_PRINTED = {
    "kuka.src": f"DEFDAT prog\nDECL E6POS XP1={{X {X},Y {Y},Z {Z},A {_A:.6f},B {_B:.6f},"
    f"C {_C:.6f},S 6,T 2}}\nENDDAT\n",
    "kuka.txt": f"{{FRAME: X {X}, Y {Y}, Z {Z}, A {_A:.6f}, B {_B:.6f}, C {_C:.6f}}}\n",
    "module.mod": "MODULE views\n" + _robtarget("p10", POSE) + _robtarget("p20", OTHER),
    "ur.script": f"  Waypoint_1_p = p[{', '.join(f'{n:.9f}' for n in (*_M, *_VECTOR))}]\n",
    "program.ls": "/PROG VIEWS\n/POS\n" + _fanuc(1, POSE) + _fanuc(2, OTHER) + "/END\n",
    "pendant.txt": f"X: {X} Y: {Y} Z: {Z}\nW: 10.0 P: -20.0 R: 30.0\n",
    "pose.dat": "# 3D POSE PARAMETERS: rotation and translation\n\nf 2\n\nr 10 -20 30\n\n"
    f"t {X / 1000} {Y / 1000} {Z / 1000}\n",
}
_PRINTED_FAULTS: dict[str, Fault] = {
    "a position that is none": _number("412.5", "1e300", "1e999", "nan", "inf", "--4", "412.5.5"),
    "a quaternion that is none": _number(f"{_Q[0]:.9f}", "5.5", "0", "nan", "1e300"),
    "a turn that is none": _number(f"{_VECTOR[0]:.9f}", "1e300", "nan", "99"),
    "a number missing": _missing("412.5", "-123.25", f"{_Q[1]:.9f}"),
    "a key twice": _twice(rb"(?<=[{ ])X (412.5)", rb"X \1, X 99.5"),
    "an equation twice": _twice(rb"\tX = +412.5  mm,", rb"\tX = 412.5 mm,\tX = 99.5 mm,"),
}
_MATRIX_FAULTS: dict[str, Fault] = {
    "a rotation that is none": _number(
        repr(float(POSE.rotation[0, 0])), "-0.9", "5", "nan", "9e99"
    ),
    "a position that is none": _number("412.5", "1e300", "1e999", "nan", "inf", "412.5.5"),
    "a number missing": _missing("412.5", "-123.25"),
    "a key twice": _twice(rb'("?t"?: )(\[[^\]]*\])(,?)', rb"\1[1.5, 2.5, 3.5],\n\1\2\3"),
}
_VIEWS = {
    "views": [{"name": "v1", "pose": POSE.to_matrix()}, {"name": "v2", "pose": OTHER.to_matrix()}]
}
_ROTATIONS = {"a": {"R": POSE.rotation, "t": POSE.translation_mm}}


def _messages() -> dict[str, Any]:
    position = dict(zip("xyz", _M.tolist(), strict=True))
    return {"position": position, "orientation": dict(zip("wxyz", _Q.tolist(), strict=True))}


def _views() -> Any:
    return {"views": [{**each, "pose": each["pose"].tolist()} for each in _VIEWS["views"]]}


def _documents() -> dict[str, str]:
    return {
        "views.json": json.dumps(_views(), indent=1),
        "turns.json": json.dumps(_lists(_ROTATIONS), indent=1),
        "views.yaml": yaml.safe_dump(_views()),
        "message.yaml": yaml.safe_dump(_messages()),
        "turns.yaml": yaml.safe_dump(_lists(_ROTATIONS)),
        "zivid.yaml": "__version__:\n  serializer: 1\n  data: 12\nFloatMatrix:\n  Data:\n    "
        + json.dumps(POSE.to_matrix().tolist()),
    }


def _lines() -> dict[str, str]:
    def named(name: str, pose: RigidTransform) -> str:
        x, y, z = pose.translation_mm
        return f"{name},{x},{y},{z},{_quaternion(pose)}\n"

    def stamped(time: float, pose: RigidTransform) -> str:
        w, *turn = pose.to_abb_quaternion()
        numbers = (*(pose.translation_mm / 1000), *turn, w)
        return " ".join([f"{time:.6f}", *(f"{n:.9f}" for n in numbers)]) + "\n"

    return {
        "matrix.txt": _rows(POSE.to_matrix()) + "\n",
        "matrices.csv": _rows(np.stack([p.to_matrix().ravel() for p in (POSE, OTHER)]), ","),
        "table.csv": "name,x_mm,y_mm,z_mm,qw,qx,qy,qz\n" + named("v1", POSE) + named("v2", OTHER),
        "trajectory.tum": stamped(1.7e9, POSE) + stamped(1.7e9 + 1, OTHER),
    }


def _arrays(folder: Path) -> list[Sample]:
    one, many = folder / "one.npy", folder / "many.npy"
    np.save(one, POSE.to_matrix())
    np.save(many, np.stack([POSE.to_matrix(), OTHER.to_matrix()])[:, :3])
    return [Sample(one), Sample(many)]


_calibrations = partial(Format, read=_read, wrong=_wrong_calibration)
_poses = partial(Format, read=read_named_poses, wrong=_wrong_poses)
_ROTATED = {"camera.yml": {"K": K, "D": D, **SIZES}, "rig.yml": {**RIG, **RIG_SIZES}}

FORMATS: tuple[Format, ...] = (
    _calibrations(
        "OpenCV YAML calibration",
        _samples({name: _opencv(nodes) for name, nodes in _ROTATED.items()}),
        faults={
            **_CAMERA_FAULTS,
            "rows that are none": count_in(rb"rows: (\d+)"),
            "a node twice": _twice(rb"(K|cam_K): !!", rb"\1: 5\n\1: !!"),
        },
    ),
    _calibrations(
        "OpenCV XML calibration",
        _samples({f"{name[:-4]}.xml": _xml(nodes) for name, nodes in _ROTATED.items()}),
        faults={**_CAMERA_FAULTS, "rows that are none": count_in(rb"<rows>(\d+)")},
    ),
    _calibrations(
        "ROS camera_info",
        _samples({"info.yaml": _ros(), "message.yaml": _ROS_MESSAGE}),
        faults={
            **_CAMERA_FAULTS,
            "a key twice": _twice(rb"image_width: 1624", rb"image_width: 99\nimage_width: 1624"),
        },
    ),
    _calibrations(
        "JSON calibration",
        _samples(
            {
                "camera.json": json.dumps(_lists(_ROTATED["camera.yml"]), indent=1),
                "rig.json": json.dumps(_lists(_ROTATED["rig.yml"])),
                "realsense.json": json.dumps(
                    {"color": {"width": 1624, "height": 1240, "ppx": 811.25, "ppy": 622.5,
                               "fx": 2210.5, "fy": 2212.25, "model": "distortion.brown_conrady",
                               "coeffs": D.tolist()}}
                ),
            }
        ),
        faults={
            **_CAMERA_FAULTS,
            "a key twice": _twice(rb'"(image_width|cam_width)": 1624', rb'"\1": 99, "\1": 1624'),
        },
    ),
    _calibrations("text calibration", _samples(_TEXTS), faults=_CAMERA_FAULTS),
    _calibrations("NPZ calibration", _npz, text=False),
    _calibrations(
        "MATLAB calibration",
        _samples({"packed.mat": _mat(packed=True), "plain.mat": _mat(packed=False)}),
        text=False,
        slow=True,
    ),
    _poses("printed robot poses", _samples(_PRINTED), faults=_PRINTED_FAULTS),
    _poses("pose documents", _samples(_documents()), faults=_MATRIX_FAULTS),
    _poses("pose lines and tables", _samples(_lines()), faults={
        **_MATRIX_FAULTS, **{k: _PRINTED_FAULTS[k] for k in ("a quaternion that is none",)}}),
    _poses("pose arrays", _arrays, text=True, faults={
        "objects": lambda data, _: data.replace(b"<f8", b"|O "), "cut off": NPY_FAULTS["cut off"]}),
)  # fmt: skip

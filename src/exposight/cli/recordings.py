"""Recognising what comes from elsewhere: images, clouds, calibrations, pattern sequences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import yaml

from exposight.cell import read_cloud
from exposight.cli.facts import Fact, Recognised, camera_facts, fact, limits, span
from exposight.cli.output import count, number, percent
from exposight.errors import FormatError, ImageError
from exposight.geometry import (
    KNOWN_KEYS,
    CalibrationKeys,
    OpenCVFile,
    read_opencv_file,
    read_projector_camera,
    read_ros_camera_info,
)
from exposight.imaging import SEQUENCE_PRESETS, PhaseShift, read_sequence

if TYPE_CHECKING:
    from pathlib import Path


IMAGE_SUFFIXES = frozenset({".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".pgm"})
CALIBRATION_SUFFIXES = frozenset({".xml", ".yml", ".yaml"})


def recognise_frames(frames: list[Path]) -> Recognised:
    """Describe a folder of frames by its files, of which there must be one at least."""
    fitting = [
        name
        for name, sequence in SEQUENCE_PRESETS.items()
        if sum(frame.match(sequence.file_pattern) for frame in frames) == sequence.n_frames
    ]
    return Recognised(
        kind="folder of frames",
        remark="grey levels of the first",
        facts=(
            fact("frames", len(frames), f"{len(frames)}, {frames[0].name} … {frames[-1].name}"),
            *_image_facts(frames[0]),
            fact(
                "could be",
                fitting,
                f"sequence {' or '.join(fitting)}, by the number of frames"
                if fitting
                else "no known sequence; describe it in TOML for decode",
            ),
        ),
    )


def recognise_image(path: Path) -> Recognised:
    """Describe an image."""
    return Recognised(kind="image", facts=_image_facts(path))


def _image_facts(path: Path) -> tuple[Fact, ...]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        msg = f"{path}: cannot be read as an image; it may be truncated: copy or record it again"
        raise ImageError(msg)
    rows, columns = image.shape[:2]
    channels = 1 if image.ndim == 2 else image.shape[2]
    bits = 8 * image.dtype.itemsize
    full_scale = 2**bits - 1
    clipped = float(np.mean(image == full_scale))
    low, high, mean = int(image.min()), int(image.max()), float(image.mean())
    return (
        fact("size px", [columns, rows], f"{columns} × {rows}"),
        fact("bits", bits),
        fact("channels", channels, "1, grey" if channels == 1 else f"{channels}, colour"),
        fact("grey levels", [low, high], f"{low} … {high}, mean {number(mean)}"),
        fact("clipped share", clipped, f"{percent(clipped)} % at full scale"),
    )


def recognise_cloud(path: Path) -> Recognised:
    """Describe a point cloud."""
    cloud = read_cloud(path)
    shape = cloud.valid.shape
    points = cloud.valid_points.astype(np.float64)
    size = f"{shape[0]} rows × {shape[1]} columns" if cloud.organised else "no rows and columns"
    bounds = [limits(axis) for axis in points.T]
    return Recognised(
        kind="point cloud",
        facts=(
            fact("points", cloud.n_valid, f"{count(cloud.n_valid)} of {count(cloud.valid.size)}"),
            fact("organised", cloud.organised, f"{'yes' if cloud.organised else 'no'}, {size}"),
            fact("shape", list(shape), " × ".join(map(str, shape))),
            *(
                fact(f"{name} mm", bound, span(axis, "mm"))
                for name, bound, axis in zip("xyz", bounds, points.T, strict=True)
            ),
            fact("unit", "mm", "mm is taken for granted: the file does not tell"),
        ),
    )


def recognise_calibration(path: Path) -> Recognised:
    """Describe a calibration: camera and projector, one ROS camera, or any OpenCV or YAML file."""
    try:
        file = read_opencv_file(path)
    except FormatError:
        if _is_plain_yaml(path):
            return _recognise_yaml(path)
        raise
    for program, keys in KNOWN_KEYS.items():
        if {keys.camera_matrix, keys.projector_matrix} & set(file.nodes):
            return _projector_camera(path, file, program, keys)
    if is_camera_info(file):
        try:
            camera = read_ros_camera_info(path)
        except FormatError:  # one that only looks like it
            pass
        else:
            return Recognised(
                kind="calibration",
                remark="one camera, as ROS camera_info",
                facts=camera_facts("camera", camera),
            )
    if _is_plain_yaml(path) and not any(isinstance(own, np.ndarray) for own in file.nodes.values()):
        return _recognise_yaml(path)
    return Recognised(
        kind="OpenCV file",
        remark="of no program that exposight knows",
        facts=tuple(fact(name, None, _node(file, name)) for name in file.nodes),
    )


def _is_plain_yaml(path: Path) -> bool:
    """Tell whether a file says neither by its suffix nor by its first line that OpenCV wrote it."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return path.suffix.lower() in {".yml", ".yaml"} and not file.readline().startswith("%YAML")


def _recognise_yaml(path: Path) -> Recognised:
    """Describe YAML of something else, or say where it is broken."""
    try:
        first = next(yaml.safe_load_all(path.read_text(encoding="utf-8", errors="replace")), None)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "it cannot be parsed"
        msg = (
            f"{path}: broken YAML{place}: {problem}; correct it there (exposight reads measuring "
            "plans and calibrations in YAML)"
        )
        raise FormatError(msg) from error
    keys = list(map(str, first)) if isinstance(first, dict) else []
    return Recognised(
        kind="YAML file",
        remark="neither a measuring plan nor a calibration",
        facts=(fact("keys", keys, ", ".join(keys) or "none"),),
    )


def is_camera_info(file: OpenCVFile) -> bool:
    """Tell whether a file looks like ROS' description of one camera."""
    return bool({"camera_matrix.data", "camera_matrix", "K", "k"} & set(file.nodes))


def _node(file: OpenCVFile, name: str) -> str:
    node = file.nodes[name]
    if isinstance(node, str):
        return node
    if isinstance(node, float):
        return number(node, 6)
    return f"{' × '.join(map(str, np.shape(node)))} numbers"


def _projector_camera(
    path: Path, file: OpenCVFile, program: str, keys: CalibrationKeys
) -> Recognised:
    remark = f"camera and projector, as {program} writes it"
    if keys.projector_size is None:
        matrices = (("camera", keys.camera_matrix), ("projector", keys.projector_matrix))
        return Recognised(
            kind="calibration",
            remark=remark,
            facts=(
                *(
                    fact(f"{name} matrix", file.matrix(key).tolist(), _matrix(file, key))
                    for name, key in matrices
                ),
                fact(
                    "projector size px",
                    None,
                    "not in the file; decode needs --projector-size W H",
                ),
            ),
        )
    rig = read_projector_camera(path)
    baseline_mm = float(np.linalg.norm(rig.projector_from_camera.translation_mm))
    return Recognised(
        kind="calibration",
        remark=remark,
        facts=(
            *camera_facts("camera", rig.camera),
            *camera_facts("projector", rig.projector),
            fact("baseline mm", baseline_mm, f"{number(baseline_mm)} mm"),
        ),
    )


def _matrix(file: OpenCVFile, key: str) -> str:
    matrix = file.matrix(key, (3, 3))
    focal = f"{number(matrix[0, 0], 6)}, {number(matrix[1, 1], 6)}"
    return f"focal {focal} px; centre {number(matrix[0, 2], 6)}, {number(matrix[1, 2], 6)} px"


def recognise_sequence(path: Path) -> Recognised:
    """Describe a pattern sequence."""
    sequence = read_sequence(path)
    axes = []
    for axis, coding, size in sequence.axes():
        if isinstance(coding, PhaseShift):
            periods = " : ".join(f"{fringe.periods:g}" for fringe in coding.fringes)
            text = f"phase shift of {periods} periods over {size} px"
            if coding.gray_code is not None:
                text += f", {len(coding.gray_code.frames)} bits of Gray code"
        else:
            inverse = "with" if coding.inverse_frames else "without"
            text = f"Gray code of {len(coding.frames)} bits over {size} px, {inverse} inverses"
        axes.append(fact(axis, text))
    return Recognised(
        kind="pattern sequence",
        facts=(
            fact("name", sequence.name),
            fact("frames", sequence.n_frames, f"{sequence.n_frames}, {sequence.file_pattern}"),
            fact("bits", sequence.bit_depth),
            fact(
                "projector px",
                [sequence.projector_width, sequence.projector_height],
                f"{sequence.projector_width} × {sequence.projector_height}",
            ),
            *axes,
        ),
    )

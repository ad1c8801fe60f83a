"""ROS ``camera_info``: one camera, of its raw and of its rectified images.

K and D are of the images as recorded, P is of the rectified ones, and which of both were saved the
file does not say. P[3] is −fx·B of the camera's offset B along the rectified x axis, in m:
https://docs.ros.org/en/api/sensor_msgs/html/msg/CameraInfo.html.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError, SensorError
from exposight.files import recognised
from exposight.geometry.calibrations.calibration import ImageKind
from exposight.geometry.calibrations.calibration_conventions import fisheye
from exposight.geometry.calibrations.calibration_names import group_of, told_apart
from exposight.geometry.calibrations.calibration_nodes import (
    CalibrationNodes,
    Node,
    read_calibration_nodes,
)
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import check_rotation

_NAMES = {
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
    "matrix": ("camera_matrix", "K", "k"),
    "distortion": ("distortion_coefficients", "D", "d"),
}
_ROTATION = ("rectification_matrix", "R", "r")
_PROJECTION = ("projection_matrix", "P", "p")
_MODELS = {"plumb_bob", "rational_polynomial", "thin_prism", "none", ""}
_OST = {
    "camera matrix": "camera_matrix",
    "distortion": "distortion_coefficients",
    "rectification": "rectification_matrix",
    "projection": "projection_matrix",
}
_SAME_PX = 0.01
"""Cameras whose parameters differ by less see every pixel alike."""
_MM_PER_M = 1000.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraInfo:
    """What a ``camera_info`` says of a camera.

    Parameters
    ----------
    path : Path
        The file.
    raw : PinholeCamera
        Of the images as recorded: K and D.
    rectified : PinholeCamera or None
        Of the rectified images: P, without distortion. None where the file has no P.
    rectified_from_raw : (3, 3) ndarray
        Rotation of the rectified frame against the camera's.
    offset_mm : float, mm
        The camera's place along the rectified x axis, −P[3]/fx: 0 of a left camera, the baseline of
        a right one. The file has it in m.
    region_of_rectified : bool
        False where rectified images are of a region that the file does not hold (``do_rectify``).
    """

    path: Path
    raw: PinholeCamera
    rectified: PinholeCamera | None
    rectified_from_raw: NDArray[np.float64]
    offset_mm: float
    region_of_rectified: bool = True

    def camera(self, images: ImageKind | None = None) -> PinholeCamera:
        """Return the camera that took the images.

        Parameters
        ----------
        images : {'raw', 'rectified'}, optional
            What was saved. Needed where it matters: where P differs from K, or there is distortion.

        Raises
        ------
        FormatError
            If it matters and was not said, or rectified images are said and the file has no P.
        """
        if images == "raw" or (images is None and self.rectified is None):
            return self.raw
        if not self.region_of_rectified:
            msg = (
                f"{self.path}: do_rectify with a region of interest: of which region rectified "
                "images are is not in the file; export a camera_info of whole images, or say --raw"
            )
            raise FormatError(msg)
        if self.rectified is None:
            msg = f"{self.path}: no P, which rectified images need; the file is of raw images only"
            raise FormatError(msg)
        if images is None and not alike(self.raw, self.rectified):
            raise FormatError(either_kind(self.path, ("K and D", self.raw), ("P", self.rectified)))
        return self.rectified


def alike(first: PinholeCamera, second: PinholeCamera) -> bool:
    """Tell whether two cameras see every pixel alike."""
    differences = np.abs(first.matrix - second.matrix).max()
    return bool(differences < _SAME_PX) and not any(first.distortion + second.distortion)


def either_kind(
    path: Path, raw: tuple[str, PinholeCamera], rectified: tuple[str, PinholeCamera]
) -> str:
    """Return the question whether images are raw or rectified; (name of the entries, camera)."""
    lens = "with lens distortion" if any(raw[1].distortion) else "without lens distortion"
    return (
        f"{path}: the file describes raw images ({raw[0]}: focal length {raw[1].fx:.6g} px, "
        f"{lens}) and rectified ones ({rectified[0]}: {rectified[1].fx:.6g} px, none), and "
        "does not say which were saved; say --raw or --rectified (in Python images='raw' or "
        "'rectified'). "
        "Topics and files called image_rect are rectified, and so are the clouds made from them"
    )


def read_camera_info(path: str | Path, size: tuple[int, int] | None = None) -> CameraInfo:
    """Read a ROS ``camera_info`` file, as ``camera_calibration`` or a dumped message writes it.

    Parameters
    ----------
    path : path
        YAML, JSON or ost.ini with ``image_width``, ``image_height``, ``camera_matrix`` and
        ``distortion_coefficients``, or with a message's ``width``, ``height``, ``K``, ``D``; and
        ``rectification_matrix`` and ``projection_matrix``, or ``R`` and ``P``, where it has them.
        K, P and size are of the full resolution; the cameras are those of the frames, after
        ``roi`` and binning.
    size : (int, int), px, optional
        Width and height, where the file does not hold them.

    Raises
    ------
    MissingFileError, FormatError
        If the file or a key is missing, or the distortion model is not a pinhole lens's.
    """
    file = read_calibration_nodes(path)
    found = camera_infos(file)
    if len(found) > 1:
        msg = f"{path}: {len(found)} cameras; expected the camera_info of one"
        raise FormatError(msg)
    return camera_info(found[0] if found else file, size)


def read_ros_camera_info(path: str | Path, images: ImageKind | None = None) -> PinholeCamera:
    """Read the camera of a ROS ``camera_info`` file (`read_camera_info`, `CameraInfo.camera`)."""
    return read_camera_info(path).camera(images)


def camera_info(file: CalibrationNodes, size: tuple[int, int] | None = None) -> CameraInfo:
    """Return what the nodes of one ``camera_info`` say; parameters as `read_camera_info`."""
    model = str(file.nodes.get("distortion_model", ""))
    if model not in _MODELS:
        raise fisheye(file.path, model)
    if size is None or set(_NAMES["width"]) & set(file.nodes):
        width, height = (file.whole_numbers(_key(file, n), 1)[0] for n in ("width", "height"))
    else:
        width, height = size
    matrix = file.matrix(_key(file, "matrix"), (3, 3))
    distortion = file.matrix(_key(file, "distortion"))
    frames = _frames(file, (width, height))
    raw = _camera(file, matrix, frames, distortion)
    rectified, offset_mm = _projected(file, frames)
    if frames.words:
        recognised(file.path, frames.words)
    return CameraInfo(
        path=file.path,
        raw=raw,
        rectified=rectified,
        rectified_from_raw=_rotation(file),
        offset_mm=offset_mm,
        region_of_rectified=not (frames.has_region and _is_true(file, "roi.do_rectify")),
    )


def camera_infos(file: CalibrationNodes) -> list[CalibrationNodes]:
    """Return the nodes of each ``camera_info`` in a file, the left camera's first; none of others.

    A file of the calibrating program's text, ost.txt, gets the names of its YAML.
    """
    if any(name.endswith(".camera matrix") for name in file.nodes):
        file = replace(file, nodes=dict(_of_ost(file.nodes)))
    groups = [g for g in dict.fromkeys(map(group_of, file.nodes)) if _is_camera_info(file.under(g))]
    if len(groups) == 2 and told_apart(*groups).roles == ("second", "first"):
        groups.reverse()
    return [file.under(group) for group in groups]


def _is_camera_info(file: CalibrationNodes) -> bool:
    nodes = file.nodes
    if set(_NAMES["matrix"]).isdisjoint(nodes) or not {"T", "t"}.isdisjoint(nodes):
        return False
    projections = [nodes[key] for key in _PROJECTION if key in nodes]
    return not {"distortion_model", "binning_x"}.isdisjoint(nodes) or any(
        isinstance(each, np.ndarray) and each.size == 12 for each in projections
    )


def _of_ost(nodes: Mapping[str, Node]) -> Iterator[tuple[str, Node]]:
    sections = dict.fromkeys(name.partition(".")[0] for name in nodes)
    images = [each for each in sections if re.fullmatch(r"image( \d+)?", each)]
    cameras = [each for each in sections if f"{each}.camera matrix" in nodes]
    for place, camera in enumerate(cameras):
        start = f"{camera}." if len(cameras) > 1 else ""
        for name, node in nodes.items():
            section, _, leaf = name.partition(".")
            if section == camera and leaf in _OST:
                yield f"{start}{_OST[leaf]}", node
            elif place < len(images) and section == images[place]:
                yield f"{start}image_{leaf}", node


# -- binning and regions ------------------------------------------------------------------------


class _Frames(NamedTuple):
    """Which pixels of the full resolution the frames are."""

    size: tuple[int, int]
    binning: tuple[int, int] = (1, 1)
    start: tuple[int, int] = (0, 0)
    words: str = ""
    has_region: bool = False

    def of(self, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the camera matrix of the frames.

        Pixel centres are integers: a pixel of b × b has its centre at b·u + (b − 1)/2.
        """
        scaled = matrix.copy()
        for axis, (factor, start) in enumerate(zip(self.binning, self.start, strict=True)):
            scaled[axis, :2] /= factor
            scaled[axis, 2] = (matrix[axis, 2] - start + 0.5) / factor - 0.5
        return scaled


def _frames(file: CalibrationNodes, full: tuple[int, int]) -> _Frames:
    def number(key: str) -> int:
        return file.whole_numbers(key, 1)[0] if key in file.nodes else 0

    binning = (max(number("binning_x"), 1), max(number("binning_y"), 1))
    start = (number("roi.x_offset"), number("roi.y_offset"))
    width, height = number("roi.width") or full[0], number("roi.height") or full[1]
    if min(start) < 0 or start[0] + width > full[0] or start[1] + height > full[1]:
        msg = (
            f"{file.path}: a region of {width} × {height} px from {start} is not within "
            f"{full[0]} × {full[1]} px, the full resolution"
        )
        raise FormatError(msg)
    has_region = (width, height) != full
    if not has_region and binning == (1, 1):
        return _Frames(full)
    size = (width // binning[0], height // binning[1])
    words = f"frames of {size[0]} × {size[1]} px: "
    words += f"{binning[0]} × {binning[1]} binned" if binning != (1, 1) else ""
    words += ", " if has_region and binning != (1, 1) else ""
    words += f"a region of {width} × {height} px from {start}" if has_region else ""
    words += (
        f" of {full[0]} × {full[1]}; K and P are of the full resolution and were scaled, with "
        "integer pixel centres"
    )
    return _Frames(size, binning, start, words, has_region)


def _is_true(file: CalibrationNodes, key: str) -> bool:
    return str(file.nodes.get(key, "")).lower() in {"true", "1.0"}


def _camera(
    file: CalibrationNodes,
    matrix: NDArray[np.float64],
    frames: _Frames,
    distortion: NDArray[np.float64],
    what: str = "",
) -> PinholeCamera:
    width, height = frames.size
    try:
        PinholeCamera.from_matrix(matrix, width=1, height=1)
        return PinholeCamera.from_matrix(
            frames.of(matrix), width=width, height=height, distortion=distortion
        )
    except SensorError as error:
        msg = f"{file.path}: {what}{error}"
        raise FormatError(msg) from error


def _projected(file: CalibrationNodes, frames: _Frames) -> tuple[PinholeCamera | None, float]:
    """Return the camera of rectified images, and its offset in mm."""
    key = next((key for key in _PROJECTION if key in file.nodes), None)
    if key is None:
        return None, 0.0
    matrix = file.matrix(key, (3, 4))
    if not matrix[:, :3].any():  # uncalibrated
        return None, 0.0
    if abs(matrix[1, 3]) > abs(matrix[0, 3]):
        msg = (
            f"{file.path}: P offsets the camera along y ({matrix[1, 3]:g}); expected cameras side "
            "by side, with rows that correspond"
        )
        raise FormatError(msg)
    camera = _camera(file, matrix[:, :3], frames, np.zeros(0), "P: ")
    return camera, -float(matrix[0, 3]) / float(matrix[0, 0]) * _MM_PER_M


def _rotation(file: CalibrationNodes) -> NDArray[np.float64]:
    key = next((key for key in _ROTATION if key in file.nodes), None)
    rotation = np.eye(3) if key is None else file.matrix(key, (3, 3))
    return check_rotation(rotation) if rotation.any() else np.eye(3)  # all 0: uncalibrated


def _key(file: CalibrationNodes, name: str) -> str:
    for key in _NAMES[name]:
        if key in file.nodes:
            return key
    expected = "' or '".join(_NAMES[name])
    msg = f"{file.path}: no key '{expected}'; {file.listed()}"
    raise FormatError(msg)

"""ROS ``camera_info``: one camera, of its raw and of its rectified images.

K and D are of the images as recorded, P is of the rectified ones, and which of both were saved the
file does not say. P[3] is −fx·B of the camera's offset B along the rectified x axis, in m:
https://docs.ros.org/en/api/sensor_msgs/html/msg/CameraInfo.html.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError, SensorError
from exposight.geometry.calibration_files import (
    OpenCVFile,
    read_camera,
    read_opencv_file,
    read_size,
)
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import check_rotation

ImageKind: TypeAlias = Literal["raw", "rectified"]
"""What a camera's images are: as recorded, or turned and freed from distortion."""

_NAMES = {
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
    "matrix": ("camera_matrix.data", "camera_matrix", "K", "k"),
    "distortion": ("distortion_coefficients.data", "distortion_coefficients", "D", "d"),
}
_ROTATION = ("rectification_matrix.data", "rectification_matrix", "R", "r")
_PROJECTION = ("projection_matrix.data", "projection_matrix", "P", "p")
_MODELS = {"plumb_bob", "rational_polynomial", "none", ""}
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
    """

    path: Path
    raw: PinholeCamera
    rectified: PinholeCamera | None
    rectified_from_raw: NDArray[np.float64]
    offset_mm: float

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


def read_camera_info(path: str | Path) -> CameraInfo:
    """Read a ROS ``camera_info`` file, as ``camera_calibration`` or a dumped message writes it.

    Parameters
    ----------
    path : path
        YAML with ``image_width``, ``image_height``, ``camera_matrix`` and
        ``distortion_coefficients``, or with a message's ``width``, ``height``, ``K``, ``D``; and
        ``rectification_matrix`` and ``projection_matrix``, or ``R`` and ``P``, where it has them.

    Raises
    ------
    MissingFileError, FormatError
        If the file or a key is missing, or the distortion model is not a pinhole lens's.
    """
    file = read_opencv_file(path)
    model = str(file.nodes.get("distortion_model", ""))
    if model not in _MODELS:
        msg = (
            f"{file.path}: distortion model '{model}' is not a pinhole lens's; expected "
            "'plumb_bob' or 'rational_polynomial'"
        )
        raise FormatError(msg)
    size = read_size(file, (_key(file, "width"), _key(file, "height")))
    raw = read_camera(file, _key(file, "matrix"), _key(file, "distortion"), size)
    rectified, offset_mm = _projected(file, size)
    return CameraInfo(
        path=file.path,
        raw=raw,
        rectified=rectified,
        rectified_from_raw=_rotation(file),
        offset_mm=offset_mm,
    )


def read_ros_camera_info(path: str | Path, images: ImageKind | None = None) -> PinholeCamera:
    """Read the camera of a ROS ``camera_info`` file (`read_camera_info`).

    Parameters
    ----------
    path : path
        The file.
    images : {'raw', 'rectified'}, optional
        What was saved (`CameraInfo.camera`).

    Raises
    ------
    MissingFileError, FormatError
        As `read_camera_info` and `CameraInfo.camera`.
    """
    return read_camera_info(path).camera(images)


def is_camera_info(file: OpenCVFile) -> bool:
    """Tell whether a file has the keys of a ``camera_info``."""
    return not set(_NAMES["matrix"]).isdisjoint(file.nodes)


def _projected(file: OpenCVFile, size: tuple[int, int]) -> tuple[PinholeCamera | None, float]:
    """Return the camera of rectified images, and its offset in mm."""
    key = next((key for key in _PROJECTION if key in file.nodes), None)
    if key is None:
        return None, 0.0
    matrix = file.matrix(key)
    if matrix.size != 12:
        msg = f"{file.path}: node '{key}' must be 3×4 or 12 numbers, got shape {matrix.shape}"
        raise FormatError(msg)
    matrix = matrix.reshape(3, 4)
    if not matrix[:, :3].any():  # uncalibrated
        return None, 0.0
    if abs(matrix[1, 3]) > abs(matrix[0, 3]):
        msg = (
            f"{file.path}: P offsets the camera along y ({matrix[1, 3]:g}); expected cameras side "
            "by side, with rows that correspond"
        )
        raise FormatError(msg)
    try:
        camera = PinholeCamera.from_matrix(matrix[:, :3], width=size[0], height=size[1])
    except SensorError as error:
        msg = f"{file.path}: P: {error}"
        raise FormatError(msg) from error
    return camera, -float(matrix[0, 3]) / camera.fx * _MM_PER_M


def _rotation(file: OpenCVFile) -> NDArray[np.float64]:
    key = next((key for key in _ROTATION if key in file.nodes), None)
    rotation = np.eye(3) if key is None else file.matrix(key)
    if rotation.size != 9:
        msg = f"{file.path}: node '{key}' must be 3×3 or 9 numbers, got shape {rotation.shape}"
        raise FormatError(msg)
    rotation = rotation.reshape(3, 3)
    return check_rotation(rotation) if rotation.any() else np.eye(3)  # all 0: uncalibrated


def _key(file: OpenCVFile, name: str) -> str:
    for key in _NAMES[name]:
        if key in file.nodes:
            return key
    keys = dict.fromkeys(key.removesuffix(".data") for key in _NAMES[name])
    expected = "' or '".join(keys)
    msg = f"{file.path}: no key '{expected}'; the file has {', '.join(file.nodes)}"
    raise FormatError(msg)

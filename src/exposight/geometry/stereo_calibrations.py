"""Calibrations of two cameras: OpenCV's ``stereoCalibrate``, and two ROS ``camera_info``.

OpenCV's stereo sample writes M1, D1, M2, D2 to one file and R, T to another, where X₂ = R·X₁ + T
takes a point from the first camera's frame to the second's: T is not the second camera's place.
``stereoRectify`` adds P1 and P2 of the rectified images. None of them holds the images' size.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions import settle
from exposight.contradictions.rigs import baseline
from exposight.errors import FormatError, PoseError, SensorError
from exposight.geometry.calibration_files import (
    OpenCVFile,
    read_camera,
    read_opencv_file,
    read_size,
)
from exposight.geometry.camera_info import (
    CameraInfo,
    ImageKind,
    alike,
    either_kind,
    is_camera_info,
    read_camera_info,
)
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform

STEREO_KEYS: Mapping[str, tuple[str, str, str, str]] = MappingProxyType(
    {
        "opencv": ("M1", "D1", "M2", "D2"),
        "opencv, by K": ("K1", "D1", "K2", "D2"),
        "opencv, spelled out": ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
    }
)
"""Names of the nodes: matrix and distortion of the first and of the second camera."""

_SIZES = (
    ("image_width", "image_height"),
    ("imageWidth", "imageHeight"),
    ("width", "height"),
)
_SAME_BASELINE = 0.01
"""P2 and T of one calibration give the same baseline but for rounding."""


@dataclass(frozen=True, kw_only=True)
class StereoCameras:
    """Two calibrated cameras.

    Parameters
    ----------
    first, second : PinholeCamera
        The left and the right one.
    first_from_second : RigidTransform
        Where the second is, seen from the first, mm. Calibration files hold its inverse.
    images : {'raw', 'rectified'}
        Of which images they are. The frame of rectified ones is turned against the raw ones'.
    """

    first: PinholeCamera
    second: PinholeCamera
    first_from_second: RigidTransform
    images: ImageKind
    source: str = "the calibration"
    """Which files, for messages."""

    def __post_init__(self) -> None:
        settle([baseline(self.baseline_mm, f"both cameras in {self.source}")])

    @property
    def baseline_mm(self) -> float:
        """Distance between both cameras."""
        return float(np.linalg.norm(self.first_from_second.translation_mm))


def is_stereo_file(path: str | Path) -> bool:
    """Tell whether an OpenCV file holds two cameras, or the pose between two.

    Raises
    ------
    MissingFileError, FormatError
        As `read_opencv_file`.
    """
    nodes = read_opencv_file(path).nodes
    return _keys(nodes) is not None or ({"R", "T"} <= set(nodes) and "K" not in nodes)


def read_stereo_cameras(
    path: str | Path,
    second: str | Path | None = None,
    *,
    images: ImageKind | None = None,
    size: tuple[int, int] | None = None,
) -> StereoCameras:
    """Read two cameras from OpenCV's stereo files, or from two ROS ``camera_info``.

    Parameters
    ----------
    path : path
        OpenCV's M1, D1, M2, D2, and R, T with them or in the second file; or the left camera's
        ``camera_info``.
    second : path, optional
        OpenCV's R and T, or the right camera's ``camera_info``, whose P[3] is −fx·baseline with the
        baseline in m, as ROS has it.
    images : {'raw', 'rectified'}, optional
        What was saved. Needed where the files describe both and they differ.
    size : (int, int), px, optional
        Width and height of the images, which OpenCV's files do not hold.

    Raises
    ------
    MissingFileError, FormatError
        If a file or node is missing or malformed, or the size or the kind of the images is not
        known.
    PoseError
        If R is no rotation.
    ContradictionError
        If the cameras cannot stand so close, or so far apart.
    """
    files = [read_opencv_file(each) for each in (path, second) if each is not None]
    if all(map(is_camera_info, files)):
        if second is None:
            msg = f"{path}: one camera; a stereo pair needs the right one's camera_info as well"
            raise FormatError(msg)
        return _ros_pair(read_camera_info(path), read_camera_info(second), images)
    return _opencv_pair(_together(files), images, size)


# -- ROS ----------------------------------------------------------------------------------------


def _ros_pair(left: CameraInfo, right: CameraInfo, images: ImageKind | None) -> StereoCameras:
    for each in (left, right):
        if each.rectified is None:
            msg = (
                f"{each.path}: no P, or one of zeros; P[3] of a stereo pair's right camera holds "
                "the baseline: export the camera_info after the stereo calibration"
            )
            raise FormatError(msg)
    cameras = [each.camera(images) for each in (left, right)]
    baseline_mm = right.offset_mm - left.offset_mm
    if baseline_mm <= 0.0:
        msg = (
            f"{right.path}: P[3] must be −fx·baseline of the right camera, so below 0, and 0 of "
            f"the left one; the files put it {baseline_mm:g} mm to the right of {left.path}"
        )
        if baseline_mm < 0.0:
            msg += ": name the left camera's file first"
        raise FormatError(msg)
    place = np.array([baseline_mm, 0.0, 0.0])
    if images != "raw":
        pose = RigidTransform(translation_mm=place)
    else:
        from_rectified = left.rectified_from_raw.T
        pose = RigidTransform(
            rotation=from_rectified @ right.rectified_from_raw,
            translation_mm=from_rectified @ place,
        )
    return StereoCameras(
        first=cameras[0],
        second=cameras[1],
        first_from_second=pose,
        images=images or "rectified",
        source=f"{right.path}, whose P[3] is −fx·baseline in m,",
    )


# -- OpenCV -------------------------------------------------------------------------------------


def _together(files: list[OpenCVFile]) -> OpenCVFile:
    nodes = {name: node for file in files for name, node in file.nodes.items()}
    return replace(files[0], nodes=nodes)


def _keys(nodes: Mapping[str, object]) -> tuple[str, str, str, str] | None:
    return next((keys for keys in STEREO_KEYS.values() if set(keys) <= set(nodes)), None)


def _opencv_pair(
    file: OpenCVFile, images: ImageKind | None, size: tuple[int, int] | None
) -> StereoCameras:
    keys = _keys(file.nodes)
    if keys is None or not {"R", "T"} <= set(file.nodes):
        known = "; ".join(", ".join(names) for names in STEREO_KEYS.values())
        msg = (
            f"{file.path}: expected two cameras ({known}) with R and T, in one file or two, or two "
            f"ROS camera_infos; got {', '.join(file.nodes)}"
        )
        raise FormatError(msg)
    size = size or _image_size(file)
    raw = (read_camera(file, keys[0], keys[1], size), read_camera(file, keys[2], keys[3], size))
    translation_mm = file.matrix("T")
    try:
        second_from_first = RigidTransform(
            rotation=file.matrix("R", (3, 3)), translation_mm=translation_mm.reshape(-1)
        )
    except PoseError as error:
        msg = f"{file.path}: {error}"
        raise PoseError(msg) from error
    raw_pair = StereoCameras(
        first=raw[0],
        second=raw[1],
        first_from_second=second_from_first.inverse(),
        images="raw",
        source=str(file.path),
    )
    if not {"P1", "P2"} <= set(file.nodes):
        if images == "rectified":
            msg = (
                f"{file.path}: no P1 and P2, which rectified images need; add the file in which "
                "stereoRectify's results were written"
            )
            raise FormatError(msg)
        return raw_pair
    if images == "raw":
        return raw_pair
    rectified = _opencv_rectified(file, size, raw_pair.baseline_mm)
    if images is None:
        for names, one, other in (
            ((f"{keys[0]} and {keys[1]}", "P1"), raw_pair.first, rectified.first),
            ((f"{keys[2]} and {keys[3]}", "P2"), raw_pair.second, rectified.second),
        ):
            if not alike(one, other):
                raise FormatError(either_kind(file.path, (names[0], one), (names[1], other)))
    return rectified


def _opencv_rectified(file: OpenCVFile, size: tuple[int, int], baseline_mm: float) -> StereoCameras:
    """Return the cameras of P1 and P2, whose baseline must be T's."""
    first, second = (_projection(file, key, size) for key in ("P1", "P2"))
    offset_mm = -float(file.matrix("P2")[0, 3]) / second.fx
    if abs(offset_mm - baseline_mm) > _SAME_BASELINE * baseline_mm:
        msg = (
            f"{file.path}: P2 puts the second camera {offset_mm:.4g} mm to the right of the first, "
            f"T {baseline_mm:.4g} mm away; take both from one calibration, with the left camera "
            "first"
        )
        raise FormatError(msg)
    return StereoCameras(
        first=first,
        second=second,
        first_from_second=RigidTransform(translation_mm=np.array([offset_mm, 0.0, 0.0])),
        images="rectified",
        source=str(file.path),
    )


def _projection(file: OpenCVFile, key: str, size: tuple[int, int]) -> PinholeCamera:
    matrix: NDArray[np.float64] = file.matrix(key, (3, 4))
    try:
        return PinholeCamera.from_matrix(matrix[:, :3], width=size[0], height=size[1])
    except SensorError as error:
        msg = f"{file.path}: {key}: {error}"
        raise FormatError(msg) from error


def _image_size(file: OpenCVFile) -> tuple[int, int]:
    for keys in _SIZES:
        if set(keys) <= set(file.nodes):
            return read_size(file, keys)
    msg = f"{file.path}: the images' size is not in it; give it with --image-size WIDTH HEIGHT"
    raise FormatError(msg)

"""Two cameras: from two ROS ``camera_info``, and rectified ones by OpenCV's ``stereoRectify``.

OpenCV's stereo sample writes M1, D1, M2, D2 to one file and R, T to another, where X₂ = R·X₁ + T
takes a point from the first camera's frame to the second's: T is not the second camera's place.
``stereoRectify`` adds P1 and P2 of the rectified images. None of them holds the images' size.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from exposight.contradictions import settle
from exposight.contradictions.rigs import baseline
from exposight.errors import FormatError, SensorError
from exposight.geometry.calibrations import calibration_shapes as shapes
from exposight.geometry.calibrations.calibration import Calibration, ImageKind
from exposight.geometry.calibrations.calibration_names import told_apart
from exposight.geometry.calibrations.calibration_nodes import CalibrationNodes
from exposight.geometry.calibrations.camera_info import CameraInfo, alike, either_kind
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform

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

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Return a calibration's two cameras.

        Raises
        ------
        FormatError
            If it is of one camera.
        """
        if calibration.second is None or calibration.transform is None:
            msg = (
                f"{calibration.source}: expected two cameras with R and T, in one file or two, or "
                "two ROS camera_infos, got one camera; a stereo pair needs the right one's "
                "camera_info as well"
            )
            raise FormatError(msg)
        return cls(
            first=calibration.camera,
            second=calibration.second,
            first_from_second=calibration.transform.inverse(),
            images=calibration.images,
            source=calibration.source,
        )


def ros_pair(left: CameraInfo, right: CameraInfo, images: ImageKind | None) -> Calibration:
    """Return the cameras of two ``camera_info``.

    Raises
    ------
    FormatError
        If one has no P, the baseline is none, or raw and rectified images differ and it was not
        said which were saved.
    ContradictionError
        If they cannot stand so close or so far apart.
    """
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
    calibration = Calibration(
        source=f"{right.path}, whose P[3] is −fx·baseline in m,",
        camera=cameras[0],
        second=cameras[1],
        transform=pose.inverse(),
        images=images or "rectified",
    )
    StereoCameras.of(calibration)  # checks the baseline
    return calibration


def rectified_if_said(
    raw: Calibration, file: CalibrationNodes, images: ImageKind | None
) -> Calibration:
    """Return one camera or two as they are of the saved images: raw, or by P, or P1 and P2.

    Raises
    ------
    FormatError
        If both are in the file and differ and it was not said which were saved, what was said is
        not in it, or the baseline of rectified cameras is not T's.
    """
    if raw.images == "rectified" and raw.second is None:
        if images == "raw":
            msg = f"{file.path}: a projection alone, of rectified images; raw ones need K and D"
            raise FormatError(msg)
        return raw
    names = list(shapes.projections(file.nodes))
    count = 1 if raw.second is None else 2
    if images == "raw" or (images is None and len(names) != count):
        return raw
    if len(names) != count:
        msg = f"{file.path}: no P, which rectified images need; the file is of raw images only"
        if count == 2:
            msg = (
                f"{file.path}: no P1 and P2, which rectified images need; add the file in which "
                "stereoRectify's results were written"
            )
        raise FormatError(msg)
    if raw.second is None:
        camera = _projection(file, names[0], (raw.camera.width, raw.camera.height))
        rectified = replace(raw, camera=camera, images="rectified")
    else:
        if told_apart(*names).roles == ("second", "first"):
            names.reverse()
        rectified = _rectified(raw, file, *names)
    if images is None:
        devices = ["camera"] if count == 1 else ["first camera", "second camera"]
        pairs = ((raw.camera, rectified.camera), (raw.second, rectified.second))
        for device, name, (one, other) in zip(devices, names, pairs, strict=False):
            assert one is not None
            assert other is not None
            if not alike(one, other):
                nodes = [node for node, what in raw.taken.items() if what == device][:2]
                of_raw = " and ".join(nodes)
                raise FormatError(either_kind(file.path, (of_raw, one), (name, other)))
    return rectified


def _rectified(raw: Calibration, file: CalibrationNodes, left: str, right: str) -> Calibration:
    """Return the cameras of P1 and P2, whose baseline must be T's."""
    size = (raw.camera.width, raw.camera.height)
    first, second = (_projection(file, key, size) for key in (left, right))
    assert raw.transform is not None
    baseline_mm = float(np.linalg.norm(raw.transform.translation_mm))
    offset_mm = -float(file.matrix(right, (3, 4))[0, 3]) / second.fx
    if abs(offset_mm - baseline_mm) > _SAME_BASELINE * baseline_mm:
        msg = (
            f"{file.path}: P2 puts the second camera {offset_mm:.4g} mm to the right of the first, "
            f"T {baseline_mm:.4g} mm away; take both from one calibration, with the left camera "
            "first"
        )
        raise FormatError(msg)
    return replace(
        raw,
        camera=first,
        second=second,
        transform=RigidTransform(translation_mm=np.array([-offset_mm, 0.0, 0.0])),
        images="rectified",
    )


def _projection(file: CalibrationNodes, key: str, size: tuple[int, int]) -> PinholeCamera:
    matrix = file.matrix(key, (3, 4))
    try:
        return PinholeCamera.from_matrix(matrix[:, :3], width=size[0], height=size[1])
    except SensorError as error:
        msg = f"{file.path}: {key}: {error}"
        raise FormatError(msg) from error

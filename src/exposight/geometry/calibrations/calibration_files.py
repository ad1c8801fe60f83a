"""The one way from calibration files to cameras, projectors and the poses between them.

`read_calibration` reads any of them: ROS ``camera_info`` (one, or a pair), and everything that is
recognised by shape (`recognise_calibration`). Camera and projector are a `ProjectorCamera`, two
cameras are `StereoCameras`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from exposight.contradictions import settle
from exposight.contradictions.rigs import baseline
from exposight.errors import FormatError
from exposight.files import parsing
from exposight.geometry.calibrations.calibration import (
    Calibration,
    ImageKind,
    recognise_calibration,
)
from exposight.geometry.calibrations.calibration_lenses import SecondDevice
from exposight.geometry.calibrations.calibration_nodes import (
    CalibrationKeys,
    CalibrationNodes,
    read_calibration_nodes,
)
from exposight.geometry.calibrations.camera_info import camera_info, camera_infos
from exposight.geometry.calibrations.stereo_calibrations import (
    StereoCameras,
    rectified_if_said,
    ros_pair,
)
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform


@dataclass(frozen=True, kw_only=True)
class ProjectorCamera:
    """A calibrated camera and projector.

    Calibration files hold ``projector_from_camera``, the motion that takes a point from the
    camera's frame to the projector's (``Rp`` and ``Tp`` of SLStudio): its translation is *not*
    the projector's position. Sensors hold the projector's pose in the camera's frame, which is the
    inverse, ``camera_from_projector``. Here is where one becomes the other.

    Parameters
    ----------
    camera, projector : PinholeCamera
        Intrinsic parameters; the projector is a camera with its light running the other way.
    projector_from_camera : RigidTransform
        Extrinsic parameters, mm.

    Raises
    ------
    ContradictionError
        If both cannot stand so close or so far apart.
    """

    camera: PinholeCamera
    projector: PinholeCamera
    projector_from_camera: RigidTransform

    def __post_init__(self) -> None:
        apart_mm = float(np.linalg.norm(self.projector_from_camera.translation_mm))
        settle([baseline(apart_mm, "camera and projector")])

    @property
    def camera_from_projector(self) -> RigidTransform:
        """The projector's pose in the camera's frame, as sensors hold it."""
        return self.projector_from_camera.inverse()

    def to_slstudio(self) -> str:
        """Write an OpenCV YAML file that names its nodes as SLStudio does."""
        file = cv2.FileStorage(
            ".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
        )
        for letter, lens in (("c", self.camera), ("p", self.projector)):
            file.write(f"K{letter}", lens.matrix)
            file.write(f"k{letter}", np.array(lens.distortion or (0.0,) * 5)[None])
        file.write("Rp", self.projector_from_camera.rotation)
        file.write("Tp", self.projector_from_camera.translation_mm[:, None])
        for name, size in (
            ("frameWidth", self.camera.width),
            ("frameHeight", self.camera.height),
            ("screenResX", self.projector.width),
            ("screenResY", self.projector.height),
        ):
            file.write(name, size)
        return str(file.releaseAndGetString())


def read_calibration(
    path: str | Path,
    more: str | Path | None = None,
    *,
    keys: CalibrationKeys | None = None,
    images: ImageKind | None = None,
    image_size: tuple[int, int] | None = None,
    projector_size: tuple[int, int] | None = None,
    second: SecondDevice | None = None,
) -> Calibration:
    """Read a calibration of one camera, of camera and projector, or of two cameras.

    Parameters
    ----------
    path : path
        The file (`read_calibration_nodes`).
    more : path, optional
        OpenCV's file of R and T, or the right camera's ``camera_info``, whose P[3] is −fx·baseline
        with the baseline in m, as ROS has it.
    keys : CalibrationKeys, optional
        Which nodes are what, for those that their names do not tell.
    images : {'raw', 'rectified'}, optional
        What was saved. Needed where the files describe both and they differ.
    image_size, projector_size : (int, int), px, optional
        Width and height, where the files do not hold them.
    second : {'camera', 'projector'}, optional
        What the second of two devices is, where their names only number them; a camera by default.

    Raises
    ------
    MissingFileError, FormatError
        If a file cannot be read, or what is needed is not in it.
    AmbiguousError
        If two readings fit; its message has the keys that answer.
    PoseError
        If the rotation is none.
    ContradictionError
        If both devices cannot stand so close or so far apart, or look away from each other where
        the inverse pose has them look at the same place.
    """
    # Numbers that overflow are met by the checks of cameras and poses.
    with parsing(path, "calibration"), np.errstate(all="ignore"):
        return _read(path, more, keys, images, image_size, projector_size, second)


def _read(
    path: str | Path,
    more: str | Path | None,
    keys: CalibrationKeys | None,
    images: ImageKind | None,
    image_size: tuple[int, int] | None,
    projector_size: tuple[int, int] | None,
    second: SecondDevice | None,
) -> Calibration:
    files = [read_calibration_nodes(each) for each in (path, more) if each is not None]
    infos = [info for file in files for info in camera_infos(file)]
    if infos and len(infos) >= len(files):
        if keys is not None:
            msg = f"{path}: a ROS camera_info, whose entries are known; leave out the keys"
            raise FormatError(msg)
        if len(infos) > 2:
            msg = f"{path}: {len(infos)} cameras; expected one or two camera_infos"
            raise FormatError(msg)
        if len(infos) == 1 and second is not None:
            msg = f"{path}: one camera; "
            msg += (
                "a stereo pair needs the right one's camera_info as well"
                if second == "camera"
                else "expected the calibration of camera and projector"
            )
            raise FormatError(msg)
        both = [camera_info(info, image_size) for info in infos]
        if len(both) == 2:
            return ros_pair(both[0], both[1], images)
        return Calibration(source=str(path), camera=both[0].camera(images), images=images or "raw")
    file = _together(files)
    found = recognise_calibration(
        file, keys=keys, image_size=image_size, projector_size=projector_size, second=second
    )
    if len(files) > 1 and found.second is None and found.projector is None:
        msg = (
            f"{path} and {more}: one camera in both; a pair needs R and T, and both cameras' or "
            "the projector's matrices"
        )
        raise FormatError(msg)
    if found.projector is None:
        return rectified_if_said(found, file, images)
    if images == "rectified":
        msg = f"{path}: camera and projector are of raw images; leave out --rectified"
        raise FormatError(msg)
    return found


def _together(files: list[CalibrationNodes]) -> CalibrationNodes:
    first, *others = files
    for other in others:
        for name in first.nodes.keys() & other.nodes.keys():
            if not np.array_equal(np.asarray(first.nodes[name]), np.asarray(other.nodes[name])):
                msg = (
                    f"{first.path} and {other.path} both have a node '{name}', and they differ; "
                    "give one file, or two of one calibration"
                )
                raise FormatError(msg)
        first = replace(first, nodes={**first.nodes, **other.nodes})
    return first


def read_projector_camera(
    path: str | Path,
    keys: CalibrationKeys | None = None,
    *,
    more: str | Path | None = None,
    image_size: tuple[int, int] | None = None,
    projector_size: tuple[int, int] | None = None,
) -> ProjectorCamera:
    """Read a camera, a projector and the transform between them; parameters as `read_calibration`.

    Of devices that their names only number, or call left and right, the second is the projector.

    Raises
    ------
    ExposightError
        As `read_calibration`; FormatError if it is of one camera, or of two.
    """
    found = read_calibration(
        path,
        more,
        keys=keys,
        image_size=image_size,
        projector_size=projector_size,
        second="projector",
    )
    return projector_camera(found)


def projector_camera(calibration: Calibration) -> ProjectorCamera:
    """Return a calibration's camera and projector.

    Raises
    ------
    FormatError
        If it is of one camera, or of two.
    """
    if calibration.projector is None or calibration.transform is None:
        got = "one camera" if calibration.second is None else "two cameras"
        msg = (
            f"{calibration.source}: expected a camera and a projector, got {got}; use the "
            "calibration of camera and projector, or name their nodes with --keys "
            "camera_matrix=…,projector_matrix=…"
        )
        raise FormatError(msg)
    return ProjectorCamera(
        camera=calibration.camera,
        projector=calibration.projector,
        projector_from_camera=calibration.transform,
    )


def read_stereo_cameras(
    path: str | Path,
    second: str | Path | None = None,
    *,
    keys: CalibrationKeys | None = None,
    images: ImageKind | None = None,
    size: tuple[int, int] | None = None,
) -> StereoCameras:
    """Read two cameras; parameters as `read_calibration`, `size` of both cameras' images.

    Raises
    ------
    ExposightError
        As `read_calibration`; FormatError if it is of one camera.
    """
    found = read_calibration(
        path, second, keys=keys, images=images, image_size=size, second="camera"
    )
    return StereoCameras.of(found)

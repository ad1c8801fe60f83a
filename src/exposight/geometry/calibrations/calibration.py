"""Calibrations as any program writes them: one camera, camera and projector, or two cameras.

Nodes are recognised by their shapes, and told apart by words in their names (cam, proj, left,
right, Kc, Kp, 1, 2); where that leaves two readings, `CalibrationKeys` are asked for. Between both
devices X₂ = R·X₁ + T holds, OpenCV's convention, unless the file says otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.errors import FormatError, SensorError
from exposight.files import recognised
from exposight.geometry.calibrations import calibration_shapes as shapes
from exposight.geometry.calibrations.calibration_conventions import in_opencv_terms
from exposight.geometry.calibrations.calibration_keys import CalibrationKeys
from exposight.geometry.calibrations.calibration_lenses import (
    Device,
    Lens,
    SecondDevice,
    find_coefficients,
    find_lenses,
)
from exposight.geometry.calibrations.calibration_nodes import CalibrationNodes
from exposight.geometry.calibrations.calibration_poses import FoundPose, find_pose
from exposight.geometry.calibrations.calibration_sizes import find_size, missing_size
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform

ImageKind: TypeAlias = Literal["raw", "rectified"]
"""What a camera's images are: as recorded, or turned and freed from distortion."""

_OWN = {"Kc", "kc", "Kp", "kp", "Rp", "Tp", "frameWidth, frameHeight", "screenResX, screenResY"}
"""Nodes as exposight itself writes them, SLStudio's, of which nothing needs to be said."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a calibration file holds.

    Parameters
    ----------
    source : str
        The files, for messages.
    camera : PinholeCamera
        The camera, or the first of two.
    second : PinholeCamera or None
        The second camera.
    projector : PinholeCamera or None
    transform : RigidTransform or None
        Takes points of the camera's frame to the second camera's or the projector's, mm.
    images : {'raw', 'rectified'}
        Of which images the cameras are.
    taken : mapping of str to str
        What each node was taken for: ``{"cam_K": "camera"}``; poses for ``pose``.
    """

    source: str
    camera: PinholeCamera
    second: PinholeCamera | None = None
    projector: PinholeCamera | None = None
    transform: RigidTransform | None = None
    images: ImageKind = "raw"
    taken: Mapping[str, str] = field(default_factory=dict)


def recognise_calibration(
    file: CalibrationNodes,
    *,
    keys: CalibrationKeys | None = None,
    image_size: tuple[int, int] | None = None,
    projector_size: tuple[int, int] | None = None,
    second: SecondDevice | None = None,
) -> Calibration:
    """Return the calibration that a file's nodes are, by their shapes and names.

    Parameters
    ----------
    file : CalibrationNodes
        Nodes of one file, or of two that belong together.
    keys : CalibrationKeys, optional
        Which nodes are what, for those that the names do not tell.
    image_size, projector_size : (int, int), px, optional
        Width and height, where the file does not hold them.
    second : {'camera', 'projector'}, optional
        What the second of two devices is, where they are just numbered, or left and right.

    Raises
    ------
    FormatError
        If what is needed is not in it, or malformed; all that is missing is named.
    AmbiguousError
        If two readings fit; its message has the keys that answer.
    PoseError
        If the rotation is none.
    ContradictionError
        If both devices cannot stand so.
    """
    keys = keys or CalibrationKeys()
    file, remarks = in_opencv_terms(file)
    lenses = find_lenses(file, keys, second)
    coefficients = find_coefficients(file, keys, lenses)
    taken: dict[str, str] = {}
    missing: list[str] = []
    cameras: dict[Device, PinholeCamera] = {}
    for device, lens in lenses.items():
        name = _spelled(device, lenses)
        taken[lens.name] = name
        if (node := coefficients[device].name) is not None:
            taken[node] = name
        given = projector_size if device == "projector" else image_size
        size = find_size(file, keys, device, lenses, given)
        if size is None:
            if device != "second" or not missing:  # both cameras lack it: said once
                missing.append(missing_size(device))
            continue
        if size.names:
            taken[size.names] = name
        cameras[device] = _camera(file, lens, size.size, coefficients[device].numbers)
    pose: FoundPose | None = None
    for device in lenses:
        if device != "camera":
            found = find_pose(file, keys, device)
            if isinstance(found, str):
                missing.append(found)
            else:
                pose = found
                taken |= dict.fromkeys(found.names, "pose")
                remarks = [*remarks, *found.remarks]
    if missing:
        msg = f"{file.path}: {'; '.join(dict.fromkeys(missing))}; {file.listed()}"
        raise FormatError(msg)
    if any(each.name is None for each in coefficients.values()):
        remarks = [*remarks, "no lens distortion"]
    if "second" in lenses and second is None and keys.second_matrix is None:
        remarks = [*remarks, "with --projector-size W H the second is a projector"]
    rectified, of_images = _image_kind(file, lenses, taken)
    remarks = [*remarks, *of_images]
    if remarks or set(taken) != _OWN:
        recognised(file.path, _sentence(taken, "projector" in lenses), *remarks)
    return Calibration(
        source=str(file.path),
        camera=cameras["camera"],
        second=cameras.get("second"),
        projector=cameras.get("projector"),
        transform=None if pose is None else pose.transform,
        images="rectified" if rectified else "raw",
        taken=taken,
    )


def _image_kind(
    file: CalibrationNodes, lenses: Mapping[Device, Lens], taken: Mapping[str, str]
) -> tuple[bool, list[str]]:
    """Return whether the camera's matrix is a projection, of rectified images, and what to say."""
    remarks = []
    left_out = [name for name in shapes.derived_matrices(file.nodes) if name not in taken]
    if left_out:
        remarks.append(f"{', '.join(left_out)} of undistorted images left out")
    node = file.nodes[lenses["camera"].name]
    rectified = isinstance(node, np.ndarray) and node.size == 12
    if rectified:
        remarks.append(f"{lenses['camera'].name} is of rectified images")
    return rectified, remarks


def _spelled(device: Device, lenses: Mapping[Device, Lens]) -> str:
    if "second" not in lenses:
        return device
    return "first camera" if device == "camera" else "second camera"


def _camera(
    file: CalibrationNodes, lens: Lens, size: tuple[int, int], coefficients: NDArray[np.float64]
) -> PinholeCamera:
    try:
        return PinholeCamera.from_matrix(
            lens.matrix, width=size[0], height=size[1], distortion=coefficients
        )
    except SensorError as error:
        msg = f"{file.path}: {lens.name}: {error}"
        raise FormatError(msg) from error


def _sentence(taken: Mapping[str, str], has_projector: bool) -> str:
    """Return in a line what was recognised as what."""
    devices = dict.fromkeys(what for what in taken.values() if what != "pose")
    parts = [
        f"{device} from {', '.join(node for node, what in taken.items() if what == device)}"
        for device in devices
    ]
    pose = [node for node, what in taken.items() if what == "pose"]
    if pose:
        frames = (
            "the camera's frame to the projector's"
            if has_projector
            else "the first camera's frame to the second's"
        )
        parts.append(f"{', '.join(pose)} take {frames}")
    return "; ".join(parts)

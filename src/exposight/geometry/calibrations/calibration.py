"""Calibrations as any program writes them: one camera, camera and projector, or two cameras.

Nodes are recognised by their shapes, and told apart by words in their names (cam, proj, left,
right, Kc, Kp, 1, 2); where that leaves two readings, `CalibrationKeys` are asked for. Between both
devices X₂ = R·X₁ + T holds, OpenCV's convention, unless the file says otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions import settle
from exposight.contradictions.rigs import axes_crossing, baseline
from exposight.errors import ContradictionError, FormatError, PoseError, SensorError
from exposight.files import recognised
from exposight.files.reading import current_reading
from exposight.geometry.calibrations import calibration_shapes as shapes
from exposight.geometry.calibrations.calibration_conventions import in_opencv_terms, unit_mm
from exposight.geometry.calibrations.calibration_lenses import (
    Device,
    Lens,
    SecondDevice,
    find_coefficients,
    find_lenses,
    find_size,
    missing_size,
)
from exposight.geometry.calibrations.calibration_names import group_of, is_directed, is_inverse
from exposight.geometry.calibrations.calibration_nodes import (
    CalibrationKeys,
    CalibrationNodes,
    ask_which,
)
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform

_UNIT_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
_ANYWHERE_MM = (1.0, 1e6)
"""Working distances for the question whether axes cross before both devices at all."""
_WAYS = {
    "projector": ("projector_from_camera", "camera_from_projector"),
    "second": ("second_from_first", "first_from_second"),
}


@dataclass(frozen=True, kw_only=True)
class FoundPose:
    """The motion from the camera's frame to the other device's, mm, and where it was found."""

    transform: RigidTransform
    names: tuple[str, ...]
    remarks: tuple[str, ...] = ()


def find_pose(file: CalibrationNodes, keys: CalibrationKeys, device: Device) -> FoundPose | str:
    """Return the motion from the camera's frame to another device's, or what is missing.

    Raises
    ------
    PoseError
        If the rotation is none.
    AmbiguousError
        If several nodes could be it.
    ContradictionError
        If both devices cannot stand so, or look away from each other where the inverse has them
        look at the same place.
    """
    written = _written(file, keys)
    if isinstance(written, str):
        return written
    rotation, translation, names = written
    scale, remark = _scale(file, names)
    remarks = [remark] if remark else []
    try:
        motion = RigidTransform(rotation=rotation, translation_mm=scale * translation)
    except PoseError as error:
        msg = f"{file.path}: {', '.join(names)}: {error}"
        raise PoseError(msg) from error
    _check_baseline(file, motion, device)
    forward, backward = _WAYS[device]
    if keys.direction is not None:
        inverse = keys.direction in {"camera_from_projector", "first_from_second"}
    else:
        if not all(map(is_directed, names)):
            question = f"{', '.join(names)} may lead from the camera's frame or to it."
            raise ask_which(file, question, "direction", _WAYS[device])
        inverse = any(is_inverse(name.rpartition(".")[2]) for name in names)
        remarks += _check_direction(file, motion, inverse, names, (forward, backward))
    if inverse:
        remarks.append(f"{', '.join(names)} are {backward}, and were inverted")
    return FoundPose(
        transform=motion.inverse() if inverse else motion,
        names=names,
        remarks=tuple(remarks),
    )


def _written(
    file: CalibrationNodes, keys: CalibrationKeys
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[str, ...]] | str:
    """Return rotation, translation and their nodes, or what is missing."""
    if keys.pose is not None:
        matrix = file.matrix(keys.pose)
        if matrix.size not in {12, 16}:
            msg = f"{file.path}: node '{keys.pose}' must be 4×4 or 3×4, got {matrix.shape}"
            raise FormatError(msg)
        matrix = matrix.reshape(-1, 4)
        return matrix[:3, :3], matrix[:3, 3], (keys.pose,)
    turns, ways = shapes.rotations(file.nodes), shapes.translations(file.nodes)
    if keys.rotation is not None:
        turns = {keys.rotation: file.matrix(keys.rotation, (3, 3))}
    if keys.translation is not None:
        ways = {keys.translation: file.matrix(keys.translation).reshape(-1)}
    if turns and ways:
        turn = _one(file, "rotation", turns)
        beside = {name: each for name, each in ways.items() if group_of(name) == group_of(turn)}
        way = _one(file, "translation", ways if len(ways) == 1 else beside or ways)
        return turns[turn], ways[way], (turn, way)
    motions = shapes.motions(file.nodes)
    if motions:
        name = _one(file, "pose", motions)
        return motions[name][:3, :3], motions[name][:3, 3], (name,)
    missing = "rotation" if not turns else "translation"
    return (
        f"no {missing} between both devices is in the file; add the one that holds it (OpenCV's "
        f"extrinsics.yml), name it with --keys {missing}=…, or name one camera alone with --keys "
        "camera_matrix=…"
    )


def _one(file: CalibrationNodes, entry: str, found: Mapping[str, object]) -> str:
    if len(found) > 1:
        question = f"{', '.join(found)} could be the {entry}."
        raise ask_which(file, question, entry, list(found))
    return next(iter(found))


def _scale(file: CalibrationNodes, names: tuple[str, ...]) -> tuple[float, str]:
    """Return how many mm the translation's unit has, and what to say of it."""
    if any(name.endswith("T_cn_cnm1") for name in names):  # converted already
        return 1.0, ""
    if (unit := current_reading().unit) is not None:
        return _UNIT_MM[unit], ""
    if (told := unit_mm(file)) is not None:
        return told[0], "" if told[0] == 1.0 else f"lengths are in {told[1]}"
    if any(name.lower().endswith(("_m", "[m]", "(m)")) for name in names):
        return 1000.0, "the translation is in m by its name"
    return 1.0, ""


def _check_baseline(file: CalibrationNodes, motion: RigidTransform, device: Device) -> None:
    name = "projector" if device == "projector" else "second camera"
    apart_mm = float(np.linalg.norm(motion.translation_mm))
    found = baseline(apart_mm, f"camera and {name} in {file.path}")
    if found is not None and found.is_error and "multiply" in found.explanation:
        found = replace(found, explanation=f"{found.explanation}, or say --read-as unit=m")
    settle([found])


def _check_direction(
    file: CalibrationNodes,
    motion: RigidTransform,
    inverse: bool,
    names: tuple[str, ...],
    ways: tuple[str, str],
) -> list[str]:
    """Refuse a motion whose axes cross behind, where its inverse has them cross before both.

    Where the inverse has them behind as well, nothing is known but that; it is said.
    """

    def behind(place: RigidTransform) -> bool:
        found = axes_crossing(place.rotation, place.translation_mm, "both", _ANYWHERE_MM)
        return found is not None and "behind" in found.found

    seen = motion if inverse else motion.inverse()
    if not behind(seen):
        return []
    if behind(seen.inverse()):
        return [
            f"with {', '.join(names)} both axes cross behind the camera: has the translation the "
            "wrong sign, or is the rotation transposed?"
        ]
    taken, other = reversed(ways) if inverse else ways
    msg = (
        f"{file.path}: {', '.join(names)}, taken as {taken}, make both axes cross behind the "
        f"camera; inverted, they cross before it. Say --keys direction={other} if they are the "
        f"inverse pose, or --keys direction={taken} if they are right all the same"
    )
    raise ContradictionError(msg)


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
    """Return the calibration that nodes, of one file or two, are by their shapes and names.

    Parameters and errors are `read_calibration`'s; all that is missing is named.
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

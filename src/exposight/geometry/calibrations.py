"""Calibrations as any program writes them: one camera, camera and projector, or two cameras.

Nodes are recognised by their shapes, and told apart by words in their names (cam, proj, left,
right, Kc, Kp, 1, 2); where that leaves two readings, `CalibrationKeys` are asked for. Between both
devices X₂ = R·X₁ + T holds, OpenCV's convention, unless the file says otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.contradictions import Contradiction, settle
from exposight.contradictions.rigs import axes_crossing, baseline
from exposight.errors import ContradictionError, FormatError, PoseError, SensorError
from exposight.files import recognised
from exposight.files.reading import current_reading
from exposight.geometry import calibration_shapes as shapes
from exposight.geometry.calibration_conventions import in_opencv_terms, unit_mm
from exposight.geometry.calibration_keys import NONE, CalibrationKeys, ask_for_keys
from exposight.geometry.calibration_names import (
    Role,
    affinity,
    group_of,
    is_inverse,
    is_projector,
    told_apart,
    words,
)
from exposight.geometry.calibration_nodes import CalibrationNodes
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.poses import RigidTransform

SecondDevice: TypeAlias = Literal["camera", "projector"]
ImageKind: TypeAlias = Literal["raw", "rectified"]
"""What a camera's images are: as recorded, or turned and freed from distortion."""

_UNIT_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
_SLSTUDIO = {
    "Kc",
    "kc",
    "Kp",
    "kp",
    "Rp",
    "Tp",
    "frameWidth, frameHeight",
    "screenResX, screenResY",
}
"""Nodes as exposight itself writes them, of which nothing needs to be said."""
_ANYWHERE_MM = (1.0, 1e6)
"""Working distances for the question whether axes cross before both devices at all."""


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
    taken : mapping of str to str
        What the nodes were taken for: ``{"cam_K": "camera: matrix"}``.
    images : {'raw', 'rectified'}
        Of which images the cameras are.
    """

    source: str
    camera: PinholeCamera
    second: PinholeCamera | None = None
    projector: PinholeCamera | None = None
    transform: RigidTransform | None = None
    taken: Mapping[str, str] = field(default_factory=dict)
    images: ImageKind = "raw"


class _Lens(NamedTuple):
    """A camera or projector of the file, before its size is known."""

    name: str
    matrix: NDArray[np.float64]
    words: frozenset[str]


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
        If what is needed is not in it, or malformed.
    AmbiguousError
        If two readings fit; its message has the keys that answer.
    PoseError
        If the rotation is none.
    ContradictionError
        If both devices cannot stand so close or so far apart.
    """
    file, remarks = in_opencv_terms(file)
    reader = _Reader(file, keys or CalibrationKeys(), second, image_size, projector_size)
    calibration = reader.read()
    if remarks or reader.remarks or set(calibration.taken) != _SLSTUDIO:
        recognised(file.path, calibration_words(calibration), *remarks, *reader.remarks)
    return calibration


def calibration_words(calibration: Calibration) -> str:
    """Return in a line what was recognised as what."""
    by_device: dict[str, list[str]] = {}
    for node, what in calibration.taken.items():
        by_device.setdefault(what.partition(":")[0], []).append(node)
    pose = by_device.pop("pose", [])
    parts = [f"{device} from {', '.join(names)}" for device, names in by_device.items()]
    if pose:
        other = "projector" if calibration.projector is not None else "second camera"
        parts.append(f"{', '.join(pose)} take the camera's frame to the {other}'s")
    return "; ".join(parts)


class _Reader:
    """Decides what the nodes of one file are."""

    def __init__(
        self,
        file: CalibrationNodes,
        keys: CalibrationKeys,
        second: SecondDevice | None,
        image_size: tuple[int, int] | None,
        projector_size: tuple[int, int] | None,
    ) -> None:
        self.file, self.keys, self.second = file, keys, second
        self.given = {"camera": image_size, "second": image_size, "projector": projector_size}
        self.taken: dict[str, str] = {}
        self.remarks: list[str] = []
        self.missing: list[str] = []

    def read(self) -> Calibration:
        lenses = self.lenses()
        other = next((role for role in lenses if role != "camera"), None)
        coefficients = self.coefficients(lenses)
        cameras = {
            role: self.camera(role, lens, coefficients[role], lenses)
            for role, lens in lenses.items()
        }
        transform = None if other is None else self.transform(other)
        if self.missing:
            msg = f"{self.file.path}: {'; '.join(self.missing)}; {self.file.listed()}"
            raise FormatError(msg)
        return Calibration(
            source=str(self.file.path),
            camera=cameras["camera"],
            second=cameras.get("second"),
            projector=cameras.get("projector"),
            transform=transform,
            taken=self.taken,
        )

    # -- camera matrices

    def lenses(self) -> dict[str, _Lens]:
        """Return the camera, and the second camera or the projector."""
        named = {
            "camera": self.keys.camera_matrix,
            "projector": self.keys.projector_matrix,
            "second": self.keys.second_matrix,
        }
        found = shapes.camera_matrices(self.file.nodes)
        chosen = {role: name for role, name in named.items() if name is not None}
        for name in chosen.values():
            found[name] = self.file.matrix(name, (3, 3))
        if not chosen:
            self.check_transposed()
        if not found:
            raise FormatError(self.none_found())
        rest = [name for name in found if name not in chosen.values()]
        if not chosen:
            chosen = self.roles(list(found))
        elif "camera" not in chosen:
            if len(rest) != 1:
                question = "which node is the camera's matrix?"
                raise self.ask(question, "camera_matrix", rest)
            chosen["camera"] = rest[0]
        if set(chosen) == {"camera", "second"} and self.second == "projector":
            chosen["projector"] = chosen.pop("second")
        order = sorted(chosen, key=lambda role: role != "camera")
        lenses = {}
        for role in order:
            name = chosen[role]
            partner = next((chosen[each] for each in order if each != role), None)
            own = words(name) if partner is None else told_apart(name, partner).apart[0]
            lenses[role] = _Lens(name, found[name], own)
        return lenses

    def check_transposed(self) -> None:
        for name, node in self.file.nodes.items():
            matrix = shapes.square(node, 3)
            if matrix is not None and shapes.is_camera_matrix(matrix.T) and matrix[2, :2].any():
                msg = (
                    f"{self.file.path}: '{name}' is a camera matrix transposed, and rotations may "
                    "be too: transpose them in the file, or export OpenCV's matrices"
                )
                raise FormatError(msg)

    def roles(self, names: list[str]) -> dict[str, str]:
        """Return which camera matrix is whose, by their names."""
        if len(names) == 1:
            if is_projector(names[0]):
                msg = (
                    f"{self.file.path}: {names[0]} is a projector's matrix by its name, and no "
                    f"other is a camera's; {self.file.listed()}. If it is the camera's, say "
                    f"--keys camera_matrix={names[0]}"
                )
                raise FormatError(msg)
            return {"camera": names[0]}
        if len(names) > 2:
            question = f"{len(names)} camera matrices, {', '.join(names)}; which is the camera's?"
            raise self.ask(question, "camera_matrix", names)
        told: tuple[Role, Role] | None = told_apart(*names).roles
        if told is None:
            ways = [
                f"camera_matrix={one},{role}_matrix={other}"
                for role in ("projector", "second")
                for one, other in (names, names[::-1])
                if role in {"projector", "second"} - self.impossible()
            ]
            question = f"the names {names[0]} and {names[1]} do not tell which device is which."
            raise ask_for_keys(self.file.path, question, ways)
        roles = dict(zip(told, names, strict=True))
        if "projector" in roles:
            if self.second == "camera":
                msg = f"{self.file.path}: expected two cameras, got a camera and a projector"
                raise FormatError(msg)
            return {"camera": roles["camera"], "projector": roles["projector"]}
        return {"camera": roles["first"], "second": roles["second"]}

    def impossible(self) -> set[str]:
        return {"camera": {"projector"}, "projector": {"second"}}.get(self.second or "", set())

    def ask(self, question: str, key: str, names: list[str]) -> Exception:
        if not names:
            return FormatError(f"{self.file.path}: {question} {self.file.listed()}")
        return ask_for_keys(self.file.path, question, [f"{key}={name}" for name in names[:8]])

    def none_found(self) -> str:
        if shapes.rotations(self.file.nodes) and shapes.translations(self.file.nodes):
            return (
                f"{self.file.path}: a rotation and a translation and no camera matrix; name the "
                "file with the camera matrices first, and this one after it"
            )
        return (
            f"{self.file.path}: no camera matrix, 3×3 with focal lengths in px and a last row 0 0 "
            f"1, nor fx, fy, cx, cy; {self.file.listed()}"
        )

    # -- coefficients

    def coefficients(self, lenses: Mapping[str, _Lens]) -> dict[str, NDArray[np.float64]]:
        """Return the distortion coefficients of each lens."""
        found, others = shapes.coefficient_vectors(self.file.nodes)
        named = {role: getattr(self.keys, f"{role}_distortion") for role in lenses}
        result: dict[str, NDArray[np.float64]] = {}
        for role, name in named.items():
            self.taken[lenses[role].name] = f"{_DEVICE[role, 'second' in lenses]}: matrix"
            if name == NONE:
                result[role] = np.zeros(0)
            elif name is not None:
                result[role] = self.file.matrix(name).reshape(-1)
                found.pop(name, None)
                self.note(name, role, lenses, "distortion")
        open_roles = [role for role in lenses if role not in result]
        for role, name in self.matched(open_roles, lenses, found).items():
            result[role] = found[name]
            self.note(name, role, lenses, "distortion")
        without = [role for role in lenses if role not in result]
        found = {name: each for name, each in found.items() if name not in self.taken}
        if without and (found or others or any(each.size for each in result.values())):
            names = list(found or others)
            entry = f"{without[0]}_distortion"
            question = (
                f"no lens distortion is named for {lenses[without[0]].name}; {self.file.listed()}."
            )
            options = [f"{entry}={each}" for each in (*names[:6], NONE)]
            raise ask_for_keys(self.file.path, question, options)
        for role in without:
            result[role] = np.zeros(0)
        if without:
            self.remarks.append("no lens distortion in the file")
        return result

    def note(self, name: str, role: str, lenses: Mapping[str, _Lens], what: str) -> None:
        self.taken[name] = f"{_DEVICE[role, 'second' in lenses]}: {what}"

    def matched(
        self, roles: list[str], lenses: Mapping[str, _Lens], found: Mapping[str, object]
    ) -> dict[str, str]:
        """Return the coefficients that fit each lens best by their names, and no other as well."""
        if len(lenses) == 1 and roles:
            return self.only(roles[0], lenses, list(found))
        fits: dict[str, list[str]] = {role: [] for role in roles}
        for name in found:
            scores = {
                role: affinity(name, group_of(name), lens.words, group_of(lens.name))
                for role, lens in lenses.items()
            }
            best = max(scores.values())
            winners = [role for role, score in scores.items() if score == best]
            if len(winners) == 1 and winners[0] in fits:
                fits[winners[0]].append(name)
        for role, names in fits.items():
            if len(names) > 1:
                question = f"{', '.join(names)} could be the distortion of {lenses[role].name}."
                raise self.ask(question, f"{role}_distortion", names)
        return {role: names[0] for role, names in fits.items() if names}

    def only(self, role: str, lenses: Mapping[str, _Lens], names: list[str]) -> dict[str, str]:
        """Return the coefficients of the one lens that is read, of all in the file."""
        if len(names) > 1:
            lens = lenses[role]
            scores = {n: affinity(n, group_of(n), lens.words, group_of(lens.name)) for n in names}
            names = [n for n in names if scores[n] == max(scores.values())]
        if len(names) > 1:
            question = f"{', '.join(names)} could be the distortion of {lenses[role].name}."
            raise self.ask(question, f"{role}_distortion", names)
        return {role: names[0]} if names else {}

    # -- sizes

    def camera(
        self,
        role: str,
        lens: _Lens,
        coefficients: NDArray[np.float64],
        lenses: Mapping[str, _Lens],
    ) -> PinholeCamera:
        width, height = self.size(role, lens, lenses)
        try:
            return PinholeCamera.from_matrix(
                lens.matrix, width=width, height=height, distortion=coefficients
            )
        except SensorError as error:
            msg = f"{self.file.path}: {lens.name}: {error}"
            raise FormatError(msg) from error

    def size(self, role: str, lens: _Lens, lenses: Mapping[str, _Lens]) -> tuple[int, int]:
        """Return the width and height of a device's image."""
        named = getattr(self.keys, f"{role}_size")
        if named is not None:
            return self.named_size(named, lens)
        found = shapes.sizes(self.file.nodes)
        fitting = self.fitting_sizes(role, lens, lenses, found)
        options = dict.fromkeys(self.right_way_round(each, lens, role) for each in fitting)
        if len(options) == 1:
            self.note(fitting[0].names, role, lenses, "size")
            return self.as_given(next(iter(options)), role, fitting[0].names)
        if (given := self.given[role]) is not None:
            return given
        entry = f"{role}_size"
        option = "--projector-size" if role == "projector" else "--image-size"
        if options:
            names = [each.names.replace(", ", "+") for each in fitting]
            question = f"several sizes could be of {lens.name}."
            raise self.ask(question, entry, names)
        fault = (
            f"the {_SIZE_OF[role]} size is not in the file; give its width and height ({option} W "
            f"H), or name its nodes with --keys {entry}=WIDTH+HEIGHT"
        )
        if fault.partition(";")[0] not in "".join(self.missing):
            self.missing.append(fault)
        return (1, 1)

    def as_given(self, size: tuple[int, int], role: str, names: str) -> tuple[int, int]:
        """Return a size of the file, which must be the one that the caller gave, if any."""
        given = self.given[role]
        if given is not None and tuple(given) != size:
            msg = (
                f"{self.file.path}: {names} say {size[0]} × {size[1]} px, and {given[0]} × "
                f"{given[1]} px was given for the {_SIZE_OF[role]} size; use the calibration of "
                "this resolution"
            )
            raise FormatError(msg)
        return size

    def fitting_sizes(
        self,
        role: str,
        lens: _Lens,
        lenses: Mapping[str, _Lens],
        found: list[shapes.SizeNodes],
    ) -> list[shapes.SizeNodes]:
        group, others = group_of(lens.name), [o for r, o in lenses.items() if r != role]
        top = group.split(".")[0]
        if group and (inside := [s for s in found if s.group.split(".")[0] == top and s.group]):
            same = [each for each in inside if each.group == group] or inside
            if not others or top not in {group_of(each.name).split(".")[0] for each in others}:
                return same
        elsewhere = {group_of(each.name).split(".")[0] for each in others} - {""}
        found = [each for each in found if each.group.split(".")[0] not in elsewhere]
        light = [each for each in found if shapes.size_role(each) == "projector"]
        if role == "projector":
            return light
        found = [each for each in found if each not in light]
        if len(found) > 1 and len(lenses) > 1:
            own = [e for e in found if words(e.names) & lens.words]
            found = own or found
        of_images = [each for each in found if shapes.size_role(each) == "camera"]
        return of_images or found

    def right_way_round(self, each: shapes.SizeNodes, lens: _Lens, role: str) -> tuple[int, int]:
        """Return width and height, which must fit the principal point where one node has both."""
        if each.turned is None or role == "projector":
            return each.size
        (width, height), (cx, cy) = each.size, lens.matrix[:2, 2]

        def fits(w: int, h: int) -> bool:
            return bool(0.25 < cx / w < 0.75 and 0.25 < cy / h < 0.75)

        if not fits(width, height) and fits(height, width):
            order = "height, width" if each.turned else "width, height"
            msg = (
                f"{self.file.path}: {each.names} should be ({order}) by its name, but then the "
                f"principal point ({cx:.0f}, {cy:.0f}) is far from the middle; give the size with "
                f"--image-size {height} {width} or --image-size {width} {height}"
            )
            raise FormatError(msg)
        return each.size

    def named_size(self, named: str, lens: _Lens) -> tuple[int, int]:
        if named in self.file.nodes:
            both = self.file.whole_numbers(named, 2)
            pair = shapes.SizeNodes(
                names=named,
                group="",
                size=(both[1], both[0]) if "shape" in words(named) else (both[0], both[1]),
                turned="shape" in words(named),
            )
            return self.right_way_round(pair, lens, "camera")
        wide, plus, high = named.partition("+")
        if not plus:
            self.file.node(named)
        return self.file.whole_numbers(wide, 1)[0], self.file.whole_numbers(high, 1)[0]

    # -- pose

    def transform(self, other: str) -> RigidTransform | None:
        """Return the motion from the camera's frame to the other device's, mm."""
        found = self.written_pose()
        if found is None:
            return None
        rotation, translation, names = found
        scale = self.scale(names)
        try:
            written = RigidTransform(rotation=rotation, translation_mm=scale * translation)
        except PoseError as error:
            msg = f"{self.file.path}: {', '.join(names)}: {error}"
            raise PoseError(msg) from error
        device = "projector" if other == "projector" else "second"
        self.check_baseline(written, other)
        forward = f"{device}_from_camera" if device == "projector" else "second_from_first"
        backward = f"camera_from_{device}" if device == "projector" else "first_from_second"
        inverse = any(is_inverse(name) for name in names)
        if self.keys.direction is not None:
            inverse = self.keys.direction in {"camera_from_projector", "first_from_second"}
        else:
            self.check_direction(written, inverse, names, (forward, backward))
        for name in names:
            self.taken[name] = "pose"
        if inverse:
            self.remarks.append(f"{', '.join(names)} are {backward}, and were inverted")
        return written.inverse() if inverse else written

    def written_pose(
        self,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], list[str]] | None:
        keys, nodes = self.keys, self.file.nodes
        if keys.pose is not None:
            matrix = self.file.matrix(keys.pose)
            if matrix.size not in {12, 16}:
                msg = f"{self.file.path}: node '{keys.pose}' must be 4×4 or 3×4 numbers"
                raise FormatError(msg)
            matrix = matrix.reshape(-1, 4)
            return matrix[:3, :3], matrix[:3, 3], [keys.pose]
        turns = shapes.rotations(nodes) if keys.rotation is None else {
            keys.rotation: self.file.matrix(keys.rotation, (3, 3))}  # fmt: skip
        ways = shapes.translations(nodes) if keys.translation is None else {
            keys.translation: self.file.matrix(keys.translation).reshape(-1)}  # fmt: skip
        if turns and ways:
            turn = self.one("rotation", turns)
            beside = {name: t for name, t in ways.items() if group_of(name) == group_of(turn)}
            way = self.one("translation", ways if len(ways) == 1 else beside or ways)
            return turns[turn], ways[way], [turn, way]
        motions = shapes.motions(nodes)
        if motions:
            name = self.one("pose", motions)
            return motions[name][:3, :3], motions[name][:3, 3], [name]
        missing = "rotation" if not turns else "translation"
        self.missing.append(
            f"no {missing} between both devices is in the file; add the one that holds it "
            f"(OpenCV's extrinsics.yml), name it with --keys {missing}=…, or name one camera "
            "alone with --keys camera_matrix=…"
        )
        return None

    def one(self, entry: str, found: Mapping[str, object]) -> str:
        if len(found) > 1:
            question = f"{', '.join(found)} could be the {entry}."
            raise self.ask(question, entry, list(found))
        return next(iter(found))

    def scale(self, names: list[str]) -> float:
        """Return how many mm the unit of the translation has."""
        told = unit_mm(self.file)
        if any(name.endswith("T_cn_cnm1") for name in names):
            return 1.0
        if (unit := current_reading().unit) is not None:
            return _UNIT_MM[unit]
        if told is not None:
            if told[0] != 1.0:
                self.remarks.append(f"lengths are in {told[1]}")
            return told[0]
        if any(name.lower().endswith(("_m", "[m]", "(m)")) for name in names):
            self.remarks.append("the translation is in m by its name")
            return 1000.0
        return 1.0

    def check_baseline(self, pose: RigidTransform, other: str) -> None:
        device = "projector" if other == "projector" else "second camera"
        apart_mm = float(np.linalg.norm(pose.translation_mm))
        found = baseline(apart_mm, f"camera and {device} in {self.file.path}")
        if found is not None and found.is_error and "multiply" in found.explanation:
            found = replace(found, explanation=f"{found.explanation}, or say --read-as unit=m")
        settle([found])

    def check_direction(
        self, written: RigidTransform, inverse: bool, names: list[str], ways: tuple[str, str]
    ) -> None:
        """Refuse a motion with which axes cross behind, where its inverse has them in front."""

        def crossing(place: RigidTransform) -> Contradiction | None:
            found = axes_crossing(place.rotation, place.translation_mm, "both", _ANYWHERE_MM)
            return found if found is not None and "behind" in found.found else None

        seen = written if inverse else written.inverse()
        if crossing(seen) is None or crossing(seen.inverse()) is not None:
            return
        taken, other = reversed(ways) if inverse else ways
        msg = (
            f"{self.file.path}: {', '.join(names)}, taken as {taken}, make both axes cross behind "
            f"the camera; inverted, they cross before it. Say --keys direction={other} if they are "
            f"the inverse pose, or --keys direction={taken} if they are right all the same"
        )
        raise ContradictionError(msg)


_DEVICE = {
    ("camera", False): "camera",
    ("camera", True): "first camera",
    ("second", True): "second camera",
    ("projector", False): "projector",
}
_SIZE_OF = {"camera": "images'", "second": "images'", "projector": "projector's"}

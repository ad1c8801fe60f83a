"""Poses as robots' controllers and vision programs print them, recognised by their form.

KUKA frames, ABB RAPID data, Universal Robots' ``p[…]``, Fanuc's programs and pendants, and HALCON's
pose files. A robot's program may hold many, each with its name.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from exposight.errors import AmbiguousError, PoseError
from exposight.geometry.poses import RigidTransform
from exposight.geometry.robot_poses.pose_numbers import (
    NUMBER,
    angle_remark,
    checked_metres,
    degrees_of,
    metres_of,
    number_rows,
    numbers_of,
    radians_of,
    vector_radians,
)

_FARTHEST_MM = 1e6


@dataclass(frozen=True, kw_only=True)
class WrittenPose:
    """A pose that was found in a text.

    Parameters
    ----------
    pose : RigidTransform
        Within a kilometre.
    notation : str
        The `PoseNotation` of its numbers.
    name : str
        What the text calls it; empty where it has no name.
    form : str
        As what it was recognised, for people.
    remark : str
        What looks odd about it; mostly empty.
    """

    pose: RigidTransform
    notation: str
    name: str = ""
    form: str = ""
    remark: str = ""

    def __post_init__(self) -> None:
        farthest = float(np.abs(self.pose.translation_mm).max())
        if farthest > _FARTHEST_MM:
            msg = f"a pose {farthest:g} mm away; poses within a kilometre are read"
            raise PoseError(msg)


def printed_poses(text: str, source: str | Path) -> list[WrittenPose]:
    """Return the poses of a text in a form that a controller prints; none where it has another.

    Raises
    ------
    PoseError
        If the form is known, and no pose is complete in it.
    AmbiguousError
        If it is known, and two readings of its numbers fit.
    """
    for form in (_halcon, _fanuc_program, _kuka, _abb, _ur, _labelled):
        found = form(text, source)
        if found:
            return found
    return []


_NAME = re.compile(r"([A-Za-z_$][\w$.]*(?:\[[^\]\n]*\])?)\s*:?=\s*$")


def _name_before(text: str, start: int) -> str:
    """Return the variable that the value at `start` is assigned to."""
    line = text[text.rfind("\n", 0, start) + 1 : start]
    found = _NAME.search(line)
    return found.group(1) if found else ""


# -- HALCON -------------------------------------------------------------------------------------

_HALCON_ORDERS: Mapping[int, str] = {0: "XYZ", 2: "xyz"}
_HALCON_TYPES = {
    1: "'Rp+T', 'gba', 'coordinate_system'",
    3: "'Rp+T', 'abg', 'coordinate_system'",
    5: "'Rp+T', 'rodriguez', 'coordinate_system'",
    8: "'R(p-T)', 'gba', 'point'",
    9: "'R(p-T)', 'gba', 'coordinate_system'",
    10: "'R(p-T)', 'abg', 'point'",
    11: "'R(p-T)', 'abg', 'coordinate_system'",
    12: "'R(p-T)', 'rodriguez', 'point'",
    13: "'R(p-T)', 'rodriguez', 'coordinate_system'",
}


def halcon_pose(position_m: Sequence[float], rotation: Sequence[float], code: float) -> WrittenPose:
    """Return a pose of HALCON's ``create_pose``, of type 0 (gba), 2 (abg) or 4 (Rodriguez).

    Raises
    ------
    PoseError
        If it is of another type; the message names it.
    """
    if code in _HALCON_ORDERS:
        turn = Rotation.from_euler(_HALCON_ORDERS[int(code)], rotation, degrees=True)
        form = "gba" if code == 0 else "abg"
    elif code == 4:  # the vector's length is the tangent of half the angle
        turn = Rotation.from_quat([*rotation, 1.0])
        form = "Rodriguez"
    else:
        kind = _HALCON_TYPES.get(int(code)) if float(code).is_integer() else None
        named = f"of type {code:g}" + (f" ({kind})" if kind else ", which there is not")
        msg = (
            f"a HALCON pose {named}; types 0, 2 and 4 are read ('Rp+T', 'point'): "
            "convert_pose_type (Pose, 'Rp+T', 'gba', 'point', Pose) makes one"
        )
        raise PoseError(msg)
    position_mm = 1000.0 * checked_metres(position_m, "a HALCON pose")
    return WrittenPose(
        pose=RigidTransform(rotation=turn.as_matrix(), translation_mm=position_mm),
        notation="halcon",
        form=f"HALCON pose, type {code:g} ({form}), m and degrees",
    )


def _halcon(text: str, source: str | Path) -> list[WrittenPose]:
    lines: dict[str, list[float]] = {}
    for key, rest in re.findall(r"^[ \t]*([frt])[ \t]+([-+.\d][^\n#]*)$", text, re.MULTILINE):
        words = rest.split()
        if not all(re.fullmatch(NUMBER, word) for word in words):
            return []
        lines[key] = numbers_of(words, source)
    if {key: len(numbers) for key, numbers in lines.items()} != {"f": 1, "r": 3, "t": 3}:
        return []
    return [halcon_pose(metres_of(lines["t"]), lines["r"], lines["f"][0])]


# -- KUKA ---------------------------------------------------------------------------------------

_FIELD = re.compile(rf"(?<![\w.])([A-Z]\w*)(?:\s*[:=]\s*|\s+)({NUMBER})", re.IGNORECASE)


_KRL_FIELD = re.compile(rf"(?<![\w.])([A-Z]\w*)\s+({NUMBER})", re.IGNORECASE)
"""KRL has neither colons nor equals signs in frames, as YAML and JSON have."""


def _fields(
    body: str, keys: str, source: str | Path, field: "re.Pattern[str]" = _FIELD
) -> list[float] | None:
    """Return the numbers of some keys in a text; None where one is not there."""
    pairs = [(key.upper(), word) for key, word in field.findall(body)]
    found = dict(pairs)
    if not all(key in found for key in keys):
        return None
    for key, word in pairs:
        if key in keys and word != found[key]:
            msg = f"{source}: a pose has {key} twice, {word} and {found[key]}"
            raise PoseError(msg)
    return numbers_of([found[key] for key in keys], source)


def _kuka(text: str, source: str | Path) -> list[WrittenPose]:
    text = re.sub(r"^\s*;.*$", "", text, flags=re.MULTILINE)
    found, partial, joints = [], 0, 0
    for match in re.finditer(r"\{([^{}]*)\}", text):
        body = re.sub(r"^\s*\w+\s*:", "", match.group(1))
        keys = {key.upper() for key, _ in _KRL_FIELD.findall(body)}
        joints += {"A1", "A2", "A3"} <= keys
        if not keys & {"X", "Y", "Z"} or '"' in body:
            continue
        line = text[text.rfind("\n", 0, match.start()) + 1 : match.start()]
        numbers = _fields(body, "XYZABC", source, _KRL_FIELD)
        if numbers is None and len(keys & set("XYZABC")) > 3:
            missing = ", ".join(sorted(set("XYZABC") - keys))
            msg = f"{source}: the KUKA frame {{{body.strip()[:60]}}} has no number for {missing}"
            raise PoseError(msg)
        if numbers is None or re.search(r"_REL\s*$", line, re.IGNORECASE):
            partial += 1
            continue
        found.append(
            WrittenPose(
                pose=RigidTransform.from_kuka_abc(numbers[:3], *degrees_of(numbers[3:])),
                notation="kuka",
                name=_name_before(text, match.start()),
                form="KUKA frame, mm and degrees",
                remark=angle_remark(numbers[3:]),
            )
        )
    if not found and joints:
        msg = (
            f"{source}: only joint angles {{A1 …, A2 …}}; a pose needs a frame {{X …, Y …, Z …, "
            "A …, B …, C …}: let the controller show the Cartesian position ($POS_ACT)"
        )
        raise PoseError(msg)
    if not found and partial:
        msg = f"{source}: a KUKA frame needs X, Y, Z, A, B and C; none here has them all"
        raise PoseError(msg)
    return found


# -- ABB ----------------------------------------------------------------------------------------

_N = r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_PAIR = re.compile(r"\[\s*\[" + ",".join([_N] * 3) + r"\]\s*,\s*\[" + ",".join([_N] * 4) + r"\]")
_TARGET = re.compile(_PAIR.pattern + r"\s*,\s*\[[^\]]*\]\s*,\s*\[[^\]]*\]\s*\]")
_DATA = re.compile(
    r"\b(robtarget|pose|tooldata|wobjdata)\s+(\w+)\s*(\{[\d,\s]*\})?\s*:=([^;]*)", re.IGNORECASE
)


def _abb(text: str, source: str | Path) -> list[WrittenPose]:
    text = re.sub(r"^\s*!.*$", "", text, flags=re.MULTILINE)
    found = []
    for kind, name, array, value in _DATA.findall(text):
        poses = [_pair(match) for match in _PAIR.finditer(value)]
        if not poses and value.lstrip().startswith("["):  # no call, such as Offs(…)
            msg = f"{source}: {name} is no {kind}: expected numbers [[x,y,z],[q1,q2,q3,q4] …"
            raise PoseError(msg)
        if kind.lower() == "wobjdata" and len(poses) == 2:
            poses = [poses[0] @ poses[1]]  # user frame, and the object frame in it
        elif kind.lower() == "tooldata":
            poses = poses[:1]
        for number, pose in enumerate(poses, start=1):
            each = f"{name}{{{number}}}" if array else name
            found.append(_abb_pose(pose, each, kind.lower()))
    if found:
        return found
    inline = [_abb_pose(_pair(match), "", "robtarget") for match in _TARGET.finditer(text)]
    if not inline and re.search(r"\bjointtarget\b", text):
        msg = f"{source}: only jointtargets, which are joint angles; a pose needs a robtarget"
        raise PoseError(msg)
    return inline


def abb_pairs(text: str) -> list[WrittenPose]:
    """Return RAPID's ``pose`` without its name: ``[[x,y,z],[q1,q2,q3,q4]]``."""
    return [_abb_pose(_pair(match), "", "pose") for match in _PAIR.finditer(text)]


def _abb_pose(pose: RigidTransform, name: str, kind: str) -> WrittenPose:
    form = f"ABB {kind}, mm, quaternion q1 to q4 with its scalar part first"
    return WrittenPose(pose=pose, notation="abb", name=name, form=form)


def _pair(match: "re.Match[str]") -> RigidTransform:
    numbers = [float(word) for word in match.groups()[:7]]
    return RigidTransform.from_abb_quaternion(numbers[:3], numbers[3:])


# -- Universal Robots ---------------------------------------------------------------------------


def _ur(text: str, source: str | Path) -> list[WrittenPose]:
    found = []
    for match in re.finditer(r"(?<![\w.])p\s*\[([^\[\]]*)\]", text):
        numbers = _ur_numbers(match.group(1))
        if numbers is None:
            msg = (
                f"{source}: p[…] of Universal Robots holds x, y, z in m and rx, ry, rz in rad, got "
                f"p[{match.group(1)}]"
            )
            raise PoseError(msg)
        found.append(
            WrittenPose(
                pose=ur_pose([*metres_of(numbers[:3]), *radians_of(numbers[3:])]),
                notation="ur",
                name=_name_before(text, match.start()),
                form="Universal Robots pose, m and rotation vector in rad",
            )
        )
    return found


def _ur_numbers(body: str) -> list[float] | None:
    """Return six numbers, whose decimals may be behind commas where only that gives six."""
    for rows in number_rows(" ".join(body.split())):
        if len(rows) == 1 and len(rows[0][1]) == 6:
            return rows[0][1]
    return None


def ur_pose(numbers: Sequence[float]) -> RigidTransform:
    """Return the pose of six numbers of a UR controller, m and rad.

    Raises
    ------
    AmbiguousError
        If the position can only be in mm.
    PoseError
        If the vector turns by more than a full turn.
    """
    vector = vector_radians(numbers[3:])
    return RigidTransform.from_ur_rotation_vector(checked_metres(numbers[:3], "a UR pose"), vector)


# -- Fanuc, and forms that name each number -----------------------------------------------------


def _fanuc_program(text: str, source: str | Path) -> list[WrittenPose]:
    blocks = re.findall(r"\bP\[\s*(\d+)\s*(?::[^\]]*)?\]\s*\{(.*?)\}", text, re.DOTALL)
    found, frames, left = [], set(), []
    for number, body in blocks:
        first = re.split(r"\bGP[2-9]\s*:", body)[0]
        tool = re.search(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)", first)
        numbers = _fields(re.sub(r"CONFIG\s*:\s*'[^']*'", "", first), "XYZWPR", source)
        keys = {key.upper() for key, _ in _FIELD.findall(first)} & set("XYZWPR")
        if numbers is None and len(keys) > 2:
            missing = ", ".join(sorted(set("XYZWPR") - keys))
            msg = f"{source}: P[{number}] has no number for {missing}"
            raise PoseError(msg)
        if numbers is None:
            left.append(f"P[{number}]")
            continue
        frames.add(tool.groups() if tool else ())
        frame = f" in UF {tool[1]} of UT {tool[2]}" if tool else ""
        found.append(_fanuc_pose(numbers, f"P[{number}]", f"Fanuc position{frame}"))
    if blocks and not found:
        msg = (
            f"{source}: no position has X, Y, Z, W, P and R (joint angles, or not recorded): "
            "set the positions' representation to Cartesian"
        )
        raise PoseError(msg)
    remarks = [f"left out {', '.join(left[:4])}: not Cartesian"] if left else []
    if len(frames) > 1:
        spelled = ", ".join(" ".join(("UF", *pair[:1], "UT", *pair[1:])) for pair in sorted(frames))
        remarks.append(f"the positions are in several frames: {spelled}")
    if found and remarks:
        said = "; ".join(filter(None, (found[0].remark, *remarks)))
        found[0] = replace(found[0], remark=said)
    return found


def _fanuc_pose(numbers: Sequence[float], name: str, what: str) -> WrittenPose:
    return WrittenPose(
        pose=RigidTransform.from_fanuc_wpr(numbers[:3], *degrees_of(numbers[3:])),
        notation="fanuc",
        name=name,
        form=f"{what}, mm and degrees",
        remark=angle_remark(numbers[3:]),
    )


_LABELLED = re.compile(
    rf"(?<![\w.])(R[XYZ]|[XYZWPRABC])(?:\s*[:=]\s*|\s+)({NUMBER})\s*(mm|m|deg|rad|°)?(?![\w\[])",
    re.IGNORECASE,
)
_ANGLES: Mapping[str, Callable[[Sequence[float], str], WrittenPose]] = {
    "WPR": lambda n, name: _fanuc_pose(n, name, "x y z w p r of a Fanuc"),
    "ABC": lambda n, name: WrittenPose(
        pose=RigidTransform.from_kuka_abc(n[:3], *degrees_of(n[3:])),
        notation="kuka",
        name=name,
        form="x y z a b c of a KUKA, mm and degrees",
        remark=angle_remark(n[3:]),
    ),
}


def _labelled(text: str, source: str | Path) -> list[WrittenPose]:
    """Read ``X: 1.0 Y: … Z: … W: … P: … R: …``, each number behind its letter."""
    found = []
    for group in _runs(list(_LABELLED.finditer(text))):
        letters = [match.group(1).upper() for match in group]
        angles = "".join(letters[3:])
        numbers = numbers_of([match.group(2) for match in group], source)
        if angles == "RXRYRZ":
            numbers = _vector_of(group, numbers, source)
            pose = WrittenPose(
                pose=ur_pose(numbers), notation="ur", form="x y z rx ry rz with their units"
            )
        else:
            units = {(match.group(3) or "").lower() for match in group[:3]}
            if units == {"m"}:
                numbers = [*(1000.0 * n for n in numbers[:3]), *numbers[3:]]
            line = text[text.rfind("\n", 0, group[0].start()) + 1 : group[0].start()]
            name = re.search(r"(\w+(?:\[[^\]]*\])?)[\s:={,;]*$", line)
            pose = _ANGLES[angles](numbers, name.group(1) if name else "")
        found.append(pose)
    return found


def _runs(matches: Sequence["re.Match[str]"]) -> Iterator[Sequence["re.Match[str]"]]:
    """Yield six numbers each whose letters are those of a pose."""
    letters = [match.group(1).upper() for match in matches]
    i = 0
    while i + 6 <= len(letters):
        if letters[i : i + 3] == ["X", "Y", "Z"] and "".join(letters[i + 3 : i + 6]) in {
            *_ANGLES,
            "RXRYRZ",
        }:
            yield matches[i : i + 6]
            i += 6
        else:
            i += 1


def _vector_of(
    group: Sequence["re.Match[str]"], numbers: Sequence[float], source: str | Path
) -> list[float]:
    """Return UR's numbers in m and rad of rx ry rz whose units say that they are a vector."""
    units = [(match.group(3) or "").lower() for match in group]
    if set(units[3:]) != {"rad"} or not set(units[:3]) <= {"mm", "m"}:
        msg = (
            f"{source}: x y z rx ry rz: is that a rotation vector (Universal Robots, m and rad), "
            "or are they angles about the fixed axes (others, in degrees)? Say so: --robot-pose ur "
            "or --robot-pose fanuc with the six numbers"
        )
        raise AmbiguousError(msg, ("ur", "fanuc"))
    scale = [0.001 if unit == "mm" else 1.0 for unit in units[:3]]
    return [*(s * n for s, n in zip(scale, numbers[:3], strict=True)), *numbers[3:]]

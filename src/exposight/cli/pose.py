"""The pose of a part on the command line: a file, as a robot prints it, or a robot's chain."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from exposight.cell import ActiveSensor, Capture, Part
from exposight.cli.app import UsageError
from exposight.contradictions.part_views import would_put
from exposight.errors import PoseError
from exposight.geometry import (
    RigidTransform,
    camera_from_held_part,
    camera_from_part_of,
    check_length_unit,
    other_chains,
    parse_pose,
    read_pose,
)
from exposight.observing import n_visible, pose_that_fits, poses_in_view


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Where the part stands in the camera's frame.

    Parameters
    ----------
    pose
        Pose of the part in the camera's frame: file with a 4×4 matrix in mm, or in any form that
        robots, ROS, HALCON or Zivid write; FILE#NAME of several.
    robot_pose
        The same as a robot writes it: fanuc x,y,z,w,p,r or kuka x,y,z,A,B,C in mm and degrees; abb
        x,y,z,q1,q2,q3,q4 in mm, scalar part first; ur x,y,z,rx,ry,rz in m and rad; halcon;
        quaternion_wxyz, quaternion_xyzw, rotation_vector (mm and rad), matrix; or printed, for
        text that tells it itself: {X 1,Y 2,…}, p[…], a robtarget. A file's name in place of the
        numbers is read so.
    flange
        Or the chain: the flange in the robot's base, as --robot-pose, or a file, such as
        program.ls#P[3].
    hand_eye
        With it the camera's pose on the flange (hand–eye calibration), a file.
    camera_in_base
        Or, of a fixed camera with the part on the flange, the camera's pose in the base, a file.
    part_pose
        With either the part's pose, a file: in the robot's base, or on the flange if the camera is
        fixed.
    """

    pose: Path | None = None
    robot_pose: Annotated[
        tuple[str, str] | None, Parameter(metavar="ROBOT NUMBERS", allow_leading_hyphen=True)
    ] = None
    flange: Annotated[
        tuple[str, ...] | None,
        Parameter(metavar="FILE|ROBOT NUMBERS", consume_multiple=True),
    ] = None
    hand_eye: Path | None = None
    camera_in_base: Path | None = None
    part_pose: Annotated[Path | None, Parameter(alias="--part-in-base")] = None

    @property
    def chain(self) -> tuple[object, ...]:
        """What of the chain was given."""
        parts = (self.flange, self.hand_eye, self.camera_in_base, self.part_pose)
        return tuple(part for part in parts if part is not None)

    @property
    def has_pose(self) -> bool:
        """Whether any pose was given."""
        return self.pose is not None or self.robot_pose is not None or bool(self.chain)

    def camera_from_part(self) -> RigidTransform:
        """Read the pose.

        Raises
        ------
        UsageError
            If it is not given, given twice, or a part of the chain is missing.
        PoseError
            If it is no pose.
        AmbiguousError
            If two readings fit.
        """
        ways = (self.pose is not None, self.robot_pose is not None, bool(self.chain))
        if sum(ways) != 1:
            msg = (
                "give the pose once, by --pose or --robot-pose, or by --flange, --hand-eye and "
                "--part-pose"
            )
            raise UsageError(msg)
        if self.robot_pose is not None:
            return _pose_of(*self.robot_pose)
        if self.pose is not None:
            return read_pose(self.pose)
        return self._of_chain()

    def camera_from_part_seen(self, part: Part, sensor: ActiveSensor) -> RigidTransform:
        """Read the pose, and check that a robot's chain puts the part in the sensor's view.

        Raises
        ------
        PoseError
            If it does not, and another reading of one of its poses does; the message names it.
        """
        pose = self.camera_from_part()
        if not self.chain or n_visible(part, sensor, pose):
            return pose
        others = other_chains(*self._links())
        if readings := poses_in_view(part, sensor, pose, others):
            msg = (
                "the chain of --flange and its calibration puts no feature of the part in the "
                f"sensor's view; {would_put(readings, 'in view')}"
            )
            raise PoseError(msg)
        return pose

    def check_chain(self, capture: Capture, part: Part, sensor: ActiveSensor) -> None:
        """Check that a robot's chain puts the features where a capture's points are.

        Raises
        ------
        PoseError
            If it does not, and another reading of one of its poses does; the message names it.
        """
        if not self.chain:
            return
        if words := pose_that_fits(capture, part, sensor, other_chains(*self._links())):
            msg = (
                "the chain of --flange and its calibration puts the part where no points are; "
                f"{words}"
            )
            raise PoseError(msg)

    def _of_chain(self) -> RigidTransform:
        chain, links = self._links()
        return chain(**links)

    def _links(self) -> tuple[Callable[..., RigidTransform], dict[str, RigidTransform]]:
        """Return the function of a chain and its arguments."""
        if self.flange is None or self.part_pose is None or len(self.flange) > 2:
            msg = (
                "the chain needs --flange FILE or --flange ROBOT NUMBERS, --hand-eye FILE (or "
                "--camera-in-base FILE) and --part-pose FILE"
            )
            raise UsageError(msg)
        if (self.hand_eye is None) == (self.camera_in_base is None):
            msg = (
                "give either --hand-eye (the camera on the flange) or --camera-in-base (a fixed "
                "camera)"
            )
            raise UsageError(msg)
        links = {"base_from_flange": _flange(self.flange)}
        if self.hand_eye is not None:
            links["flange_from_camera"] = _measured(self.hand_eye, "the hand–eye calibration")
            links["base_from_part"] = _measured(self.part_pose, "the part")
            return camera_from_part_of, links
        assert self.camera_in_base is not None
        links["base_from_camera"] = _measured(self.camera_in_base, "the camera")
        links["flange_from_part"] = _measured(self.part_pose, "the part")
        return camera_from_held_part, links


def _pose_of(notation: str, text: str) -> RigidTransform:
    """Return a pose of a known notation, its numbers or the name of a file with them."""
    path = Path(text)
    if len(text) < 256 and "\n" not in text and path.is_file():
        return read_pose(path, notation)
    return parse_pose(notation, text)


def _flange(words: tuple[str, ...]) -> RigidTransform:
    if len(words) == 2:
        return _pose_of(*words)
    (text,) = words
    if any(letter in text for letter in "{[=\n") and not Path(text).exists() and "#" not in text:
        return parse_pose(None, text, "--flange")
    return read_pose(text)


def _measured(path: Path, what: str) -> RigidTransform:
    """Read a part of the chain, whose length must have a unit that is sure."""
    pose = read_pose(path)
    check_length_unit(pose, path, what)
    return pose

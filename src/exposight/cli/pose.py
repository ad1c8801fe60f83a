"""The pose of a part on the command line: a matrix in a file, or as a robot writes it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from exposight.cli.app import UsageError
from exposight.geometry import RigidTransform, parse_pose, read_pose


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Where the part stands in the camera's frame.

    Parameters
    ----------
    pose
        Pose of the part in the camera's frame: text file with a 4×4 matrix, mm.
    robot_pose
        The same as a robot writes it: fanuc x,y,z,w,p,r or kuka x,y,z,A,B,C in mm and degrees; abb
        x,y,z,q1,q2,q3,q4 in mm, scalar part first; ur x,y,z,rx,ry,rz in m and rad; or
        quaternion_wxyz, quaternion_xyzw, rotation_vector (mm and rad), matrix.
    """

    pose: Path | None = None
    robot_pose: Annotated[
        tuple[str, str] | None, Parameter(metavar="ROBOT NUMBERS", allow_leading_hyphen=True)
    ] = None

    def camera_from_part(self) -> RigidTransform:
        """Read the pose.

        Raises
        ------
        UsageError
            If it is not given, or given twice.
        PoseError
            If it is no pose.
        """
        if self.robot_pose is not None and self.pose is None:
            return parse_pose(*self.robot_pose)
        if self.pose is not None and self.robot_pose is None:
            return read_pose(self.pose)
        msg = "give the pose once, by --pose or --robot-pose"
        raise UsageError(msg)

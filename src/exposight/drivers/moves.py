"""Moving to a pose by a command of the user's, and reading the pose that was reached."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np

from exposight.drivers.commands import CellCommand
from exposight.errors import PoseError, SensorError
from exposight.geometry import PoseNotation, RigidTransform
from exposight.geometry.robot_poses.pose_files import parse_pose

logger = logging.getLogger(__name__)

_NEAR_MM, _NEAR_DEG = 50.0, 5.0
"""A pose reached is no farther away; the paper notes errors of up to 5 mm (end of Sect. 3.2.2)."""

_PLACEHOLDERS = ("matrix", "fanuc", "view")


@dataclass(frozen=True, kw_only=True)
class MoveCommand(CellCommand):
    """A command that moves robot or part, and may print the pose reached.

    Parameters
    ----------
    command, timeout_s
        As for `CellCommand`. ``{matrix}`` is camera_from_part as 16 numbers, row by row, in mm, and
        ``{fanuc}`` as x,y,z,w,p,r in mm and degrees, both with commas; ``{view}`` the view's name.
    notation : str, optional
        How the pose that it prints is written (`PoseNotation`), where the text does not tell.
    """

    notation: PoseNotation | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_placeholders(_PLACEHOLDERS, "[move]")


class Mover:
    """Moves to a pose once for all captures there.

    Parameters
    ----------
    command : MoveCommand or None
        None where something else moves: poses are then taken as they are asked for.
    """

    def __init__(self, command: MoveCommand | None) -> None:
        self._command = command
        self._at: tuple[str, RigidTransform, RigidTransform] | None = None

    def move_to(self, camera_from_part: RigidTransform, view: str) -> RigidTransform:
        """Move, and return camera_from_part as the cell reports it, or as asked for.

        Raises
        ------
        SensorError
            If the command fails, or what it prints is no pose.
        """
        if self._at is not None and self._at[:2] == (view, camera_from_part):
            return self._at[2]
        self._at = None  # a move that fails leaves it anywhere
        reached = self._moved(camera_from_part, view)
        self._at = (view, camera_from_part, reached)
        return reached

    @property
    def remark(self) -> str:
        """What captures' notes say of their poses."""
        return "" if self._command else "the pose is as asked for: no [move] command reports it"

    def _moved(self, camera_from_part: RigidTransform, view: str) -> RigidTransform:
        if self._command is None:
            return camera_from_part
        matrix = camera_from_part.to_matrix().ravel().tolist()
        fanuc = [*camera_from_part.translation_mm.tolist(), *camera_from_part.to_fanuc_wpr()]
        values = {"matrix": _joined(matrix), "fanuc": _joined(fanuc), "view": view}
        printed = self._command.run(f"move to view {view!r}", values).strip()
        if not printed:
            logger.info("view %r: the move printed no pose, so it is taken as asked for", view)
            return camera_from_part
        try:
            reached = parse_pose(
                self._command.notation, printed, f"the pose printed at view {view!r}"
            )
        except PoseError as error:
            msg = f"{error}; the [move] command prints the pose reached, or nothing"
            raise SensorError(msg) from error
        _check_near(camera_from_part, reached, view)
        return reached


def _check_near(asked: RigidTransform, reached: RigidTransform, view: str) -> None:
    """Check that a pose reached is the one asked for, as far as robots err."""
    away_mm = float(np.linalg.norm(asked.translation_mm - reached.translation_mm))
    cosine = (np.trace(asked.rotation.T @ reached.rotation) - 1.0) / 2.0
    away_deg = math.degrees(math.acos(min(max(float(cosine), -1.0), 1.0)))
    if away_mm <= _NEAR_MM and away_deg <= _NEAR_DEG:
        return
    msg = (
        f"view {view!r}: the [move] command reports a pose {away_mm:.0f} mm and {away_deg:.0f}° "
        f"from the one asked for (x,y,z,w,p,r: asked {_shown(asked)}, reported {_shown(reached)}); "
        "it prints camera_from_part, not the robot's own pose or its inverse"
    )
    raise SensorError(msg)


def _shown(pose: RigidTransform) -> str:
    return ",".join(f"{each:.6g}" for each in (*pose.translation_mm, *pose.to_fanuc_wpr()))


def _joined(numbers: list[float]) -> str:
    return ",".join(f"{float(each):.17g}" for each in numbers)

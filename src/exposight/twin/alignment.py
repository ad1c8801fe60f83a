"""How well the sensor's pose is known: the error between the true pose and the reported one.

The paper's note at the end of Sect. 3.2.2: most measurements were aligned by photogrammetry, some
of the near plane by the robot's kinematics alone, with errors of up to 5 mm. A misaligned ring lies
beside its hole, so p_norm drops although the cloud is good.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from exposight.errors import InputError
from exposight.geometry import RigidTransform
from exposight.plans import view_seed

if TYPE_CHECKING:
    from numpy.typing import NDArray


AlignedBy = Literal["photogrammetry", "kinematics"]

_ALIGNMENT = 0x414C49474E  # the purpose of a stream of random numbers


@dataclass(frozen=True, kw_only=True)
class AlignmentErrors:
    """Sizes of the alignment errors, of the part's pose in the TCP frame.

    Parameters
    ----------
    photogrammetric_mm, photogrammetric_deg : float, mm and degrees
        Root mean square length of the shift and of the turn, both normally distributed. Assumed: a
        fifth of a pixel on the surface, and a turn that moves points 0.3 m from the TCP by half as
        much; the paper calls this alignment accurate and gives no figure.
    kinematic_max_mm : float, mm
        Largest shift of the robot's kinematics, in any direction; its length is uniformly
        distributed. 5 mm: the note at the end of Sect. 3.2.2 of the paper.
    kinematic_max_deg : float, degrees
        Largest turn, likewise. Assumed: 0.1° moves points 0.3 m from the TCP by 0.5 mm, so that the
        shift is the larger part of the paper's summed error.

    Raises
    ------
    InputError
        If one of them is negative or not a number.
    """

    photogrammetric_mm: float = 0.05
    photogrammetric_deg: float = 0.005
    kinematic_max_mm: float = 5.0
    kinematic_max_deg: float = 0.1

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = float(getattr(self, entry.name))
            if not (math.isfinite(value) and value >= 0):
                msg = f"alignment: {entry.name} must be a number from 0 up, got {value}"
                raise InputError(msg)
            object.__setattr__(self, entry.name, value)


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """How one view was aligned, and how wrong that is.

    Parameters
    ----------
    aligned_by : {'photogrammetry', 'kinematics'}
        The method.
    reported_from_true : RigidTransform
        The error, in the TCP frame: ``reported_from_true @ tcp_from_part`` is what is recorded.
    """

    aligned_by: AlignedBy
    reported_from_true: RigidTransform

    @property
    def notes(self) -> str:
        """The alignment in words, for a capture's notes."""
        return (
            f"aligned by {self.aligned_by}, wrong by {self.error_mm:.3f} mm and "
            f"{self.error_deg:.4f}°"
        )

    @property
    def error_mm(self) -> float:
        """Shift at the TCP, mm."""
        return float(np.linalg.norm(self.reported_from_true.translation_mm))

    @property
    def error_deg(self) -> float:
        """Turn, degrees."""
        return math.degrees(Rotation.from_matrix(self.reported_from_true.rotation).magnitude())


def draw_alignment(
    errors: AlignmentErrors, kinematic_share: float, seed: int, view: str
) -> Alignment:
    """Draw how a view is aligned, and its error.

    Parameters
    ----------
    errors : AlignmentErrors
        How large the errors are.
    kinematic_share : float, 0 to 1
        Probability that the view is aligned by the robot's kinematics.
    seed : int, 0 or more
        The plan's seed.
    view : str
        The view's name.
    """
    generator = np.random.default_rng([*view_seed(seed, view), _ALIGNMENT])
    # All numbers are drawn in any case, so that another share changes only the views it has to.
    chance = generator.random()
    normal = generator.standard_normal((2, 3))
    size = generator.random(2)
    if chance >= kinematic_share:
        shift = normal[0] * errors.photogrammetric_mm / math.sqrt(3.0)
        turn_deg = normal[1] * errors.photogrammetric_deg / math.sqrt(3.0)
        return Alignment(
            aligned_by="photogrammetry", reported_from_true=_small_motion(shift, turn_deg)
        )
    direction = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    shift = direction[0] * size[0] * errors.kinematic_max_mm
    turn_deg = direction[1] * size[1] * errors.kinematic_max_deg
    return Alignment(aligned_by="kinematics", reported_from_true=_small_motion(shift, turn_deg))


def _small_motion(shift_mm: NDArray[np.float64], turn_deg: NDArray[np.float64]) -> RigidTransform:
    rotation = Rotation.from_rotvec(turn_deg, degrees=True)
    return RigidTransform(rotation=rotation.as_matrix(), translation_mm=shift_mm)

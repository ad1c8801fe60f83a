"""Rigid transforms, and the rotation conventions that robots speak.

A transform is named ``target_from_source`` and composes by cancelling:
``tcp_from_feature = tcp_from_part @ part_from_feature``. Units and axes: ``docs/conventions.md``.

Robots write one rotation in different ways, and the same three numbers mean different rotations to
different robots. So there is no default: each reader and writer here carries its convention's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from exposight.errors import CloudError, PoseError

ROTATION_TOLERANCE = 1e-5
"""Largest entry of RᵀR − I that still counts as a rotation.

Calibration files print seven to nine significant digits, single-precision ones about seven.
"""


_ROUNDING = 1e-13
"""Deviations below this are left alone, so that a pose read from a file is the one written."""


def check_rotation(rotation: ArrayLike) -> NDArray[np.float64]:
    """Check a (3, 3) rotation and return the nearest exact one.

    So rounding in a file does not accumulate in products.

    Raises
    ------
    PoseError
        If the matrix is not 3×3, not finite, not orthonormal within `ROTATION_TOLERANCE`, or
        mirrors space.
    """
    matrix = np.asarray(rotation, dtype=np.float64)
    if matrix.shape != (3, 3):
        msg = f"a rotation must be a 3×3 matrix, got shape {matrix.shape}"
        raise PoseError(msg)
    if not np.isfinite(matrix).all():
        msg = "a rotation must be finite, got NaN or infinity; check the pose that was read"
        raise PoseError(msg)
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    if not deviation <= ROTATION_TOLERANCE:  # NaN of products that overflow, too
        msg = (
            f"not a rotation: RᵀR differs from the identity by {deviation:.2g} (at most "
            f"{ROTATION_TOLERANCE:g} is allowed); remove scale or shear, and check that the "
            "matrix was read row by row"
        )
        raise PoseError(msg)
    if np.linalg.det(matrix) < 0:
        msg = (
            "not a rotation: the determinant is −1, so the matrix mirrors space; "
            "check for a swapped or negated axis"
        )
        raise PoseError(msg)
    if deviation < _ROUNDING:
        return matrix.copy()
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def check_points(points: ArrayLike) -> NDArray[np.float64]:
    """Check (..., 3) points, NaN where one is missing, and return them as float64."""
    xyz = np.asarray(points, dtype=np.float64)
    if xyz.ndim == 0 or xyz.shape[-1] != 3:
        msg = (
            f"points must be an array (..., 3) of x, y and z, got shape {xyz.shape}; "
            "is it transposed?"
        )
        raise CloudError(msg)
    return xyz


def _check_numbers(values: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    vector = np.asarray(values, dtype=np.float64).reshape(-1)
    if vector.shape != (count,) or not np.isfinite(vector).all():
        msg = f"{name} needs {count} finite numbers, got {np.asarray(values)!r}"
        raise PoseError(msg)
    return vector


@dataclass(frozen=True, kw_only=True, eq=False)
class RigidTransform:
    """A rigid motion that maps points of a source frame to a target frame.

    Parameters
    ----------
    rotation : (3, 3) array_like
        Rotation matrix; its columns are the source's axes seen from the target.
    translation_mm : (3,) array_like, mm
        The source's origin seen from the target.

    Raises
    ------
    PoseError
        If the rotation is not a rotation or the translation is not three finite numbers.
    """

    rotation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    translation_mm: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        rotation = check_rotation(self.rotation)
        translation = _check_numbers(self.translation_mm, 3, "a translation in mm").copy()
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation_mm", translation)

    @classmethod
    def _of_checked(
        cls, rotation: NDArray[np.float64], translation_mm: NDArray[np.float64]
    ) -> RigidTransform:
        """Build a transform that follows from checked ones, without checking again."""
        transform = object.__new__(cls)
        rotation.setflags(write=False)
        translation_mm.setflags(write=False)
        object.__setattr__(transform, "rotation", rotation)
        object.__setattr__(transform, "translation_mm", translation_mm)
        return transform

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        return self._of_checked(
            self.rotation @ other.rotation,
            self.rotation @ other.translation_mm + self.translation_mm,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RigidTransform):
            return NotImplemented
        return bool(
            np.array_equal(self.rotation, other.rotation)
            and np.array_equal(self.translation_mm, other.translation_mm)
        )

    def __hash__(self) -> int:
        # Equal transforms need equal hashes, and 0.0 equals −0.0: adding 0.0 drops the sign.
        return hash(((self.rotation + 0.0).tobytes(), (self.translation_mm + 0.0).tobytes()))

    def inverse(self) -> RigidTransform:
        """Return ``source_from_target``."""
        transposed = self.rotation.T.copy()
        return self._of_checked(transposed, -transposed @ self.translation_mm)

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Map points from the source to the target frame.

        Parameters
        ----------
        points : (..., 3) array_like, mm
            Points in the source frame; NaN stays NaN.

        Returns
        -------
        (..., 3) ndarray, mm
            The same points in the target frame.

        Raises
        ------
        CloudError
            If the points are not (..., 3).
        """
        return check_points(points) @ self.rotation.T + self.translation_mm

    @property
    def z_axis(self) -> NDArray[np.float64]:
        """(3,) unit vector: the source's z axis seen from the target."""
        return self.rotation[:, 2]

    # -- 4×4 matrices ---------------------------------------------------------------------------

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> RigidTransform:
        """Read a homogeneous 4×4 matrix with its translation in mm.

        Parameters
        ----------
        matrix : (4, 4) or (3, 4) array_like
            Rotation and translation in mm; the last row, where given, must be 0 0 0 1.

        Raises
        ------
        PoseError
            If the shape or the last row is wrong, or the upper left is not a rotation.
        """
        array = np.asarray(matrix, dtype=np.float64)
        if array.shape not in {(4, 4), (3, 4)}:
            msg = f"a pose must be a 4×4 (or 3×4) matrix, got shape {array.shape}"
            raise PoseError(msg)
        if array.shape == (4, 4) and not np.allclose(array[3], [0, 0, 0, 1], atol=1e-9):
            msg = (
                f"the last row of a pose must be 0 0 0 1, got {array[3].tolist()}; "
                "is the matrix transposed?"
            )
            raise PoseError(msg)
        return cls(rotation=array[:3, :3], translation_mm=array[:3, 3])

    def to_matrix(self) -> NDArray[np.float64]:
        """Return the homogeneous (4, 4) matrix, translation in mm."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation_mm
        return matrix

    # -- robots' conventions --------------------------------------------------------------------

    @classmethod
    def from_fanuc_wpr(
        cls, position_mm: ArrayLike, w_deg: float, p_deg: float, r_deg: float
    ) -> RigidTransform:
        """Read a Fanuc pose: R = Rz(r)·Ry(p)·Rx(w), angles about the fixed x, y, z axes.

        Parameters
        ----------
        position_mm : (3,) array_like, mm
            X, Y, Z as on the teach pendant.
        w_deg, p_deg, r_deg : float, degrees
            Rotations about x, y and z. This is also the paper's (w, p, r).
        """
        angles = _check_numbers([w_deg, p_deg, r_deg], 3, "a Fanuc (w, p, r) rotation")
        rotation = Rotation.from_euler("xyz", angles, degrees=True)
        return cls(rotation=rotation.as_matrix(), translation_mm=np.asarray(position_mm))

    def to_fanuc_wpr(self) -> tuple[float, float, float]:
        """Return (w_deg, p_deg, r_deg), p in [−90°, 90°]; at p = ±90° r is set to 0."""
        return _fixed_xyz_degrees(self.rotation)

    @classmethod
    def from_kuka_abc(
        cls, position_mm: ArrayLike, a_deg: float, b_deg: float, c_deg: float
    ) -> RigidTransform:
        """Read a KUKA pose: R = Rz(A)·Ry(B)·Rx(C).

        Parameters
        ----------
        position_mm : (3,) array_like, mm
            X, Y, Z as in a KUKA ``FRAME``.
        a_deg, b_deg, c_deg : float, degrees
            Rotations about z, then the turned y, then the turned x axis.
        """
        angles = _check_numbers([a_deg, b_deg, c_deg], 3, "a KUKA (A, B, C) rotation")
        rotation = Rotation.from_euler("ZYX", angles, degrees=True)
        return cls(rotation=rotation.as_matrix(), translation_mm=np.asarray(position_mm))

    def to_kuka_abc(self) -> tuple[float, float, float]:
        """Return (a_deg, b_deg, c_deg), B in [−90°, 90°]; at B = ±90° A is set to 0."""
        w_deg, p_deg, r_deg = _fixed_xyz_degrees(self.rotation)
        return r_deg, p_deg, w_deg

    @classmethod
    def from_abb_quaternion(
        cls, position_mm: ArrayLike, quaternion_wxyz: ArrayLike
    ) -> RigidTransform:
        """Read an ABB ``pose``: a unit quaternion with its scalar part first.

        Parameters
        ----------
        position_mm : (3,) array_like, mm
            The ``pos`` of a RAPID ``pose``.
        quaternion_wxyz : (4,) array_like
            q1, q2, q3, q4 as RAPID orders them: w, x, y, z. Its norm must be 1 within 1e-3
            (RAPID prints a few decimals), and is then made exact.
        """
        quaternion = _check_numbers(quaternion_wxyz, 4, "a quaternion (w, x, y, z)")
        norm = float(np.linalg.norm(quaternion))
        if abs(norm - 1.0) > 1e-3:
            msg = (
                f"a quaternion (w, x, y, z) must have norm 1, got {norm:.6g}; "
                "check that four numbers of one orientation were read"
            )
            raise PoseError(msg)
        rotation = Rotation.from_quat(quaternion / norm, scalar_first=True)
        return cls(rotation=rotation.as_matrix(), translation_mm=np.asarray(position_mm))

    def to_abb_quaternion(self) -> NDArray[np.float64]:
        """Return (4,) w, x, y, z with w ≥ 0."""
        quaternion = Rotation.from_matrix(self.rotation).as_quat(canonical=True, scalar_first=True)
        return np.asarray(quaternion, dtype=np.float64)

    @classmethod
    def from_ur_rotation_vector(
        cls, position_m: ArrayLike, rotation_vector_rad: ArrayLike
    ) -> RigidTransform:
        """Read a Universal Robots pose ``p[x, y, z, rx, ry, rz]``.

        Parameters
        ----------
        position_m : (3,) array_like, m
            x, y, z. Universal Robots speak metres; this reader converts them to mm.
        rotation_vector_rad : (3,) array_like, rad
            Rotation axis times angle.
        """
        position = _check_numbers(position_m, 3, "a UR position in m")
        return cls.from_rotation_vector(1000.0 * position, rotation_vector_rad)

    @classmethod
    def from_rotation_vector(
        cls, position_mm: ArrayLike, rotation_vector_rad: ArrayLike
    ) -> RigidTransform:
        """Read a position and a rotation axis times its angle.

        Parameters
        ----------
        position_mm : (3,) array_like, mm
            The source's origin seen from the target.
        rotation_vector_rad : (3,) array_like, rad
            Rotation axis times angle.
        """
        vector = _check_numbers(rotation_vector_rad, 3, "a rotation vector in rad")
        rotation = Rotation.from_rotvec(vector)
        return cls(rotation=rotation.as_matrix(), translation_mm=np.asarray(position_mm))

    def to_ur_rotation_vector(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (position_m, rotation_vector_rad), the vector's length in [0, π]."""
        vector = Rotation.from_matrix(self.rotation).as_rotvec()
        return self.translation_mm / 1000.0, np.asarray(vector, dtype=np.float64)


def _fixed_xyz_degrees(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Solve R = Rz(r)·Ry(p)·Rx(w) for degrees, without scipy's warning at the gimbal lock."""
    horizontal = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    p = float(np.arctan2(-rotation[2, 0], horizontal))
    # At p = ±90° only w − r or w + r is defined: give all of it to w.
    r = float(np.arctan2(rotation[1, 0], rotation[0, 0])) if horizontal > 1e-9 else 0.0
    # From the second row of Rz(−r)·R = Ry(p)·Rx(w): unlike R's last row it does not vanish near
    # p = ±90°, so that w makes up for whatever rounding does to r there.
    row = np.cos(r) * rotation[1] - np.sin(r) * rotation[0]
    w = float(np.arctan2(-row[2], row[1]))
    w_deg, p_deg, r_deg = np.degrees([w, p, r]).tolist()
    return w_deg, p_deg, r_deg


def rotation_facing(
    z_axis: Sequence[float] | NDArray[np.float64],
    x_hint: Sequence[float] | NDArray[np.float64] = (1.0, 0.0, 0.0),
) -> NDArray[np.float64]:
    """Build a rotation whose z axis is given and whose x axis follows a hint.

    Parameters
    ----------
    z_axis : (3,) array_like
        Direction of the z axis, any length but zero.
    x_hint : (3,) array_like
        The x axis is this direction's part perpendicular to z. Where the two are parallel, the
        coordinate axis least parallel to z is taken instead.

    Returns
    -------
    (3, 3) ndarray
        Rotation whose columns are the x, y and z axes.

    Raises
    ------
    PoseError
        If a direction is zero or not finite.
    """
    z = _check_numbers(z_axis, 3, "a z axis")
    hint = _check_numbers(x_hint, 3, "a hint for the x axis")
    z_length, hint_length = float(np.linalg.norm(z)), float(np.linalg.norm(hint))
    if z_length == 0.0 or hint_length == 0.0:
        msg = "an axis needs a length above 0, got the zero vector"
        raise PoseError(msg)
    z, hint = z / z_length, hint / hint_length
    x = hint - (hint @ z) * z
    if np.linalg.norm(x) < 1e-6:
        hint = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = hint - (hint @ z) * z
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@dataclass(frozen=True, kw_only=True, eq=False)
class StackedPoses:
    """Poses ``target_from_source`` of n sources, to be moved together.

    Parameters
    ----------
    rotations : (n, 3, 3) ndarray
    translations_mm : (n, 3) ndarray, mm
    """

    rotations: NDArray[np.float64]
    translations_mm: NDArray[np.float64]

    @classmethod
    def of(cls, poses: Sequence[RigidTransform]) -> StackedPoses:
        """Stack poses."""
        return cls(
            rotations=np.stack([pose.rotation for pose in poses]),
            translations_mm=np.stack([pose.translation_mm for pose in poses]),
        )

    def moved(self, outer_from_target: RigidTransform) -> StackedPoses:
        """Return ``outer_from_target @ target_from_source`` of each."""
        rotation = outer_from_target.rotation
        moved = np.matmul(rotation, self.translations_mm[:, :, None])[:, :, 0]
        return StackedPoses(
            rotations=rotation @ self.rotations,
            translations_mm=moved + outer_from_target.translation_mm,
        )

    def at(self, place: int) -> RigidTransform:
        """Return one of them."""
        return RigidTransform._of_checked(
            self.rotations[place].copy(), self.translations_mm[place].copy()
        )

"""A small rig with strong distortion in both lenses, and what its camera sees of a plane."""

from dataclasses import dataclass

import numpy as np
import pytest

from exposight.geometry import PinholeCamera, RigidTransform


@dataclass(frozen=True)
class Scene:
    """A tilted plane before a camera and a projector, and the true coordinates."""

    camera: PinholeCamera
    projector: PinholeCamera
    projector_from_camera: RigidTransform
    points: np.ndarray  # (rows, columns, 3) mm, camera frame
    column: np.ndarray  # (rows, columns) projector px
    row: np.ndarray


@pytest.fixture(scope="session")
def scene() -> Scene:
    camera = PinholeCamera(
        width=120, height=96, fx=180.0, fy=182.0, cx=61.3, cy=46.2, skew=0.4,
        distortion=(-0.28, 0.12, 1e-3, -2e-3, -0.03),
    )  # fmt: skip
    projector = PinholeCamera(
        width=256, height=192, fx=300.0, fy=298.0, cx=120.1, cy=90.4, skew=-0.3,
        distortion=(0.25, -0.1, -2e-3, 1.5e-3, 0.02),
    )  # fmt: skip
    projector_from_camera = RigidTransform.from_fanuc_wpr([-120.0, 15.0, 20.0], 2.0, 14.0, -3.0)
    rays = np.concatenate([camera.rays(), np.ones((96, 120, 1))], axis=-1)
    normal = np.array([0.15, -0.1, 1.0])
    points = rays * (500.0 / (rays @ normal))[..., None]
    image = projector.project(projector_from_camera.apply(points))
    return Scene(camera, projector, projector_from_camera, points, image[..., 0], image[..., 1])


def lit_share(coordinate, bit, n_bits, code_width=1, blur_px=1e-9):
    """Share of light of one Gray-code bit, its edges blurred linearly over some projector px."""
    quarter = 2.0 ** (n_bits - 1 - bit)
    t = ((coordinate + 0.5) / code_width - quarter) % (4 * quarter)
    inside = np.where(
        t < 2 * quarter, quarter - np.abs(t - quarter), np.abs(t - 3 * quarter) - quarter
    )
    return np.clip(0.5 + inside * code_width / blur_px, 0.0, 1.0)


@pytest.fixture(scope="session")
def render_gray():
    """Return a renderer of bits, most significant first: coordinate -> (n_bits, ...) grey."""

    def render(coordinate, n_bits, *, code_width=1, blur_px=1e-9, black=10.0, white=210.0):
        shares = [lit_share(coordinate, b, n_bits, code_width, blur_px) for b in range(n_bits)]
        return black + (white - black) * np.array(shares)

    return render


@pytest.fixture(scope="session")
def render_fringe():
    """Return a renderer of fringes: coordinate -> (n, ...) grey levels."""

    def render(coordinate, periods, size, shifts_deg, *, mean=110.0, amplitude=80.0):
        phase = 2 * np.pi * periods * coordinate / size
        shifts = np.radians(shifts_deg).reshape(-1, *([1] * np.ndim(coordinate)))
        return mean + amplitude * np.cos(phase - shifts)

    return render

"""Rays on a mesh, where geometry says what they meet."""

import numpy as np
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from exposight.geometry.ray_casting import MISS_MM, RayCaster

BALL = trimesh.creation.icosphere(subdivisions=5, radius=100.0)
CASTER = RayCaster(np.array(BALL.vertices), np.array(BALL.faces, dtype=np.int32))


def _float32(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, dtype=np.float32)


@given(x=st.floats(-95, 95), y=st.floats(-95, 95))
def test_a_ray_meets_a_ball_at_its_height(x: float, y: float) -> None:
    distance, face, *_ = CASTER.first_hits(_float32((x, y, 300.0)), _float32((0.0, 0.0, -2.0)))
    square = 100.0**2 - x * x - y * y
    if square > 400.0:  # not near the rim, where facets are steep
        assert abs(300.0 - 2.0 * distance[0] - np.sqrt(square)) < 0.5
        assert face[0] >= 0
    elif square < -400.0:
        assert distance[0] > MISS_MM
        assert face[0] == -1


def test_a_ray_is_blocked_before_its_end_alone() -> None:
    starts = _float32((0, 0, 300), (0, 0, 300), (0, 0, 300), (0, 0, 0))
    ways = _float32((0, 0, -199), (0, 0, -201), (0, 0, 500), (0, 0, 99))
    assert CASTER.blocked(starts, ways).tolist() == [False, True, False, False]
    assert CASTER.blocked(starts[:0], ways[:0]).shape == (0,)

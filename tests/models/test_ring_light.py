"""Light's way to rings: closed forms, derivatives, invariances."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.models.rings import SENSOR

from exposight.cell import ActiveSensor
from exposight.errors import ObservationError
from exposight.geometry import RigidTransform
from exposight.models.ring_light import (
    POSE_COLUMNS,
    TURN_COLUMNS,
    RingLight,
    Rings,
    check_places,
    log_mean,
)


def rings(*poses: tuple[float, ...], turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Rings:
    frame = pl.DataFrame(poses, schema=list(POSE_COLUMNS), orient="row")
    return Rings.of(
        frame.with_columns(
            feature=pl.Series([f"f{i}" for i in range(len(poses))]),
            view=pl.lit("v"),
            **{name: pl.lit(angle) for name, angle in zip(TURN_COLUMNS, turn, strict=True)},
        )
    )


def coaxial() -> ActiveSensor:
    """Return the sensor with its projector in the camera."""
    assert SENSOR.projector is not None
    projector = replace(SENSOR.projector, camera_from_projector=RigidTransform())
    sensor = replace(SENSOR)
    # No depth could be triangulated with it, so a sensor refuses such a projector.
    object.__setattr__(sensor, "projector", projector)
    return sensor


def test_a_small_plate_that_faces_a_coaxial_sensor_follows_the_inverse_square() -> None:
    near, far = rings((0, 0, -100, 0, 0, 0.0)), rings((0, 0, 100, 0, 0, 0.0))
    values = [
        log_mean(RingLight.of(each, coaxial()).log_radiance(-np.inf, 0.3)[0])[0]
        for each in (near, far)
    ]
    expected = [np.log(1.0 / np.pi / distance**2) for distance in (500.0, 700.0)]
    np.testing.assert_allclose(values, expected, rtol=1e-4)


def test_the_lobe_is_brightest_towards_the_mirror_direction() -> None:
    facing, tilted = rings((0, 0, 0, 0, 0, 5.0)), rings((0, 0, 0, 20, 0, 5.0))
    lights = [RingLight.of(each, coaxial()) for each in (facing, tilted)]
    np.testing.assert_allclose(lights[0].half.mean(axis=1), 0.0, atol=1e-9)
    assert np.linalg.norm(lights[1].half.mean(axis=1)) == pytest.approx(
        np.sin(np.radians(20)), 1e-3
    )
    bright, dark = (log_mean(each.log_radiance(3.0, 0.2)[0])[0] for each in lights)
    assert bright > dark + 1.0


@given(s=st.floats(-3, 4), alpha=st.floats(0.08, 0.9), w=st.floats(-25, 25), p=st.floats(-25, 25))
@settings(max_examples=30, deadline=None)
def test_derivatives_are_those_of_finite_differences(
    s: float, alpha: float, w: float, p: float
) -> None:
    light = RingLight.of(rings((30, -20, 40, w, p, 6.0)), SENSOR)
    _, slopes = light.log_radiance(s, alpha)
    step = 1e-6
    by_s = light.log_radiance(s + step, alpha)[0] - light.log_radiance(s - step, alpha)[0]
    by_alpha = light.log_radiance(s, alpha + step)[0] - light.log_radiance(s, alpha - step)[0]
    lit = np.isfinite(light.log_falloff)
    np.testing.assert_allclose(slopes[0][lit], by_s[lit] / (2 * step), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(slopes[1][lit], by_alpha[lit] / (2 * step), rtol=1e-3, atol=1e-4)


def test_half_vectors_turn_with_the_part() -> None:
    # a sensor that rolls by 90° before the same place sees the part's axes turned by −90°
    straight = RingLight.of(rings((0, 0, 0, 15, 0, 5.0)), coaxial()).half.mean(axis=1)
    rolled = RingLight.of(rings((0, 0, 0, 0, 15, 5.0), turn=(0, 0, 90)), coaxial()).half.mean(
        axis=1
    )
    np.testing.assert_allclose(np.abs(straight), np.abs(rolled), atol=1e-3)


def test_points_outside_the_projectors_field_are_not_lit() -> None:
    inside, outside = rings((0, 0, 0, 0, 0, 5.0)), rings((-900, 0, 150, 0, 0, 5.0))
    assert RingLight.of(inside, SENSOR).lit.all()
    assert not RingLight.of(outside, SENSOR).lit.any()


@pytest.mark.parametrize(
    ("pose", "fact"),
    [
        ((0.0, 0.0, 700.0, 0.0, 0.0, 5.0), "1300 mm"),
        ((0.0, 0.0, 0.0, 180.0, 0.0, 5.0), "face away"),
    ],
)
def test_features_where_no_sensor_can_have_seen_them_are_refused(
    pose: tuple[float, ...], fact: str
) -> None:
    with pytest.raises(ObservationError, match=fact):
        check_places(rings(pose), np.array([np.nan]), SENSOR)


def test_poses_that_contradict_the_recorded_incidence_are_refused() -> None:
    ring = rings((0.0, 0.0, 0.0, 30.0, 0.0, 5.0))
    check_places(ring, np.array([30.0]), SENSOR)
    with pytest.raises(ObservationError, match="incidence"):
        check_places(ring, np.array([np.radians(30.0)]), SENSOR)

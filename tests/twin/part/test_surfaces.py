"""How finishes reflect light, and the grain that is fixed to the part."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import InputError
from exposight.twin.part import FINISHES, SURFACES, ClearCoat, SecondLobe, Surface
from exposight.twin.part.reflectance import GRAIN_RMS, grain, reflectance
from exposight.twin.part.surfaces import surface_table
from exposight.twin.random_numbers import NORMAL_TABLE, stream_key

NORMAL = (0.0, 0.0, -1.0)
TABLE = surface_table()

ROUNDING = 1e-9
"""Relative: two orders of evaluation of the same product."""


def _direction(polar_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    t, a = math.radians(polar_deg), math.radians(azimuth_deg)
    return math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), -math.cos(t)


def _even_reflectance(row: np.ndarray, to_light: tuple[float, float, float]) -> float:
    """Share of a beam that leaves in any direction, by the midpoint rule."""
    polar, azimuth = (np.arange(300) + 0.5) * 90 / 300, (np.arange(120) + 0.5) * 3
    total = 0.0
    for t in polar:
        weight = math.sin(math.radians(t)) * math.cos(math.radians(t))
        total += weight * sum(reflectance(row, NORMAL, to_light, _direction(t, a)) for a in azimuth)
    return total * math.radians(90 / 300) * math.radians(3.0)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(range(len(FINISHES))),
    st.floats(0, 85),
    st.floats(0, 360),
    st.floats(0, 85),
    st.floats(0, 360),
)
def test_light_and_eye_can_be_swapped(
    finish: int, light_t: float, light_a: float, eye_t: float, eye_a: float
) -> None:
    light, eye = _direction(light_t, light_a), _direction(eye_t, eye_a)
    there = reflectance(TABLE[finish], NORMAL, light, eye)
    assert there == pytest.approx(reflectance(TABLE[finish], NORMAL, eye, light), rel=ROUNDING)


@pytest.mark.parametrize("finish", FINISHES)
@pytest.mark.parametrize("polar_deg", [0.0, 60.0])
def test_no_finish_reflects_more_than_it_receives(finish: str, polar_deg: float) -> None:
    row = TABLE[FINISHES.index(finish)]
    assert 0.04 < _even_reflectance(row, _direction(polar_deg, 20.0)) < 1.0


def test_a_smooth_mirror_returns_all_light() -> None:
    mirror = replace(SURFACES["bare"], diffuse_albedo=0.0, mirror_reflectance=0.999)
    row = surface_table({**SURFACES, "bare": replace(mirror, alpha_along=0.05, alpha_across=0.05)})
    # A little is lost to masking, which single scattering does not give back.
    assert _even_reflectance(row[0], _direction(20.0, 0.0)) == pytest.approx(1.0, abs=0.02)


def test_a_matt_surface_is_lambertian() -> None:
    matt = replace(SURFACES["primer"], mirror_reflectance=0.0)
    row = surface_table({**SURFACES, "primer": matt})[FINISHES.index("primer")]
    assert reflectance(row, NORMAL, NORMAL, NORMAL) == pytest.approx(0.33 / math.pi, rel=1e-6)


def test_brushed_metal_scatters_farther_across_its_lines() -> None:
    row = TABLE[FINISHES.index("brushed")]
    light = NORMAL
    along = reflectance(row, NORMAL, light, _direction(40.0, 0.0))
    across = reflectance(row, NORMAL, light, _direction(40.0, 90.0))
    assert across > 3 * along


@pytest.mark.parametrize("finish", ["bare", "primer", "paint"])
def test_other_finishes_do_not_depend_on_the_turn_about_the_normal(finish: str) -> None:
    row = TABLE[FINISHES.index(finish)]
    values = [
        reflectance(row, NORMAL, _direction(30.0, a), _direction(20.0, a + 70.0))
        for a in range(0, 360, 30)
    ]
    assert np.allclose(values, values[0], rtol=1e-9)


def test_nothing_is_reflected_from_behind() -> None:
    assert reflectance(TABLE[0], NORMAL, (0.0, 0.0, 1.0), NORMAL) == 0.0


def _grain_of_patch(stretch: float = 1.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(-60, 60, 0.5), np.arange(-60, 60, 0.5))
    row = surface_table({"": replace(SURFACES["bare"], grain_stretch=stretch)})[0]
    return np.array(
        [grain(row, (a, b, 0.01 * a)) for a, b in zip(x.ravel(), y.ravel(), strict=True)]
    ).reshape(*x.shape, 3)


def test_grain_has_the_stated_strength() -> None:
    values = _grain_of_patch()
    assert np.abs(values).max() < 1.0
    assert np.abs(values.mean(axis=(0, 1))).max() < 0.02
    # 120 mm hold some 400 cells of the coarsest octave, which carries a quarter of the variance.
    assert values.std(axis=(0, 1)) == pytest.approx(GRAIN_RMS, rel=0.1)


def test_the_three_noises_of_the_grain_are_independent() -> None:
    correlation = np.corrcoef(_grain_of_patch().reshape(-1, 3).T)
    assert np.abs(correlation - np.eye(3)).max() < 0.1


def test_grain_is_continuous_everywhere() -> None:
    x = np.linspace(-3.0, 3.0, 6001)
    values = np.array([grain(TABLE[0], (a, 0.3, -0.2))[0] for a in x])
    # A lattice value changes by 2 at most over 0.8 mm, 1.5 times as fast in the middle; the sum
    # of the octaves' slopes is below 15/8 of the finest one's.
    assert np.abs(np.diff(values)).max() < 2 * 1.5 / 0.8 / 4 * 15 / 8 * 0.001 * 1.01


def test_brushed_grain_is_longer_than_wide() -> None:
    values = _grain_of_patch(stretch=10.0)[..., 0]
    along, across = np.diff(values, axis=1).std(), np.diff(values, axis=0).std()
    assert across > 5 * along


@pytest.mark.parametrize(
    "change",
    [
        {"alpha_along": 0.0},
        {"grain_contrast": 1.2},
        {"grain_stretch": 0},
        {"grain_size_mm": 0.0},
        {"brushed_along": (0.0, 0.0, 0.0)},
        {"coat": ClearCoat(alpha=0.0)},
        {"coat": ClearCoat(alpha=0.1, refractive_index=0.5)},
        {
            "second_lobe": SecondLobe(
                share=1.5, mirror_reflectance=0.5, alpha_along=0.1, alpha_across=0.1
            )
        },
    ],
)
def test_an_impossible_surface_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(InputError, match="a surface needs shares from 0 to 1"):
        replace(SURFACES["bare"], **change)


@pytest.mark.parametrize("surface", [("bare", 0.9), ("paint", 0.7)])
def test_a_surface_that_gives_back_too_much_is_refused(surface: tuple[str, float]) -> None:
    # Paint of albedo 0.7 would do so at grazing incidence alone.
    with pytest.raises(InputError, match="must not reflect more than comes in"):
        replace(SURFACES[surface[0]], diffuse_albedo=surface[1])


def test_every_finish_has_a_surface() -> None:
    assert set(SURFACES) == set(FINISHES)
    assert all(isinstance(surface, Surface) for surface in SURFACES.values())


def test_normal_numbers_have_variance_one() -> None:
    table = NORMAL_TABLE.astype(np.float64)
    assert table.mean() == pytest.approx(0.0, abs=1e-6)
    assert table.var() == pytest.approx(1.0, abs=1e-6)
    assert (table**4).mean() == pytest.approx(3.0, abs=0.03)  # the tails beyond ±3.7 are missing


def test_streams_of_random_numbers_differ() -> None:
    keys = {stream_key(*numbers) for numbers in [(1,), (2,), (1, 0), (1, 1), (0, 1)]}
    assert len(keys) == 5


def test_a_stream_has_no_negative_number() -> None:
    with pytest.raises(InputError, match="whole numbers of 0 or more"):
        stream_key(1, -1)

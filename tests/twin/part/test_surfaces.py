"""How finishes reflect light, and the grain that is fixed to the part."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, reject, settings
from hypothesis import strategies as st

from exposight.compiled import njit
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


@njit(error_model="numpy")
def _reflected(row: np.ndarray, to_light: tuple[float, float, float]) -> float:
    """Share of a beam that leaves in any direction: midpoints, densest at the mirrored one."""
    total, step = 0.0, math.pi / 1440
    mirrored = math.atan2(-to_light[1], -to_light[0])
    for i in range(720):
        sine, cosine = math.sin((i + 0.5) * step), math.cos((i + 0.5) * step)
        for j in range(360):
            s = (j + 0.5) / 180 - 1.0
            a = mirrored + math.pi * s**3
            out = (sine * math.cos(a), sine * math.sin(a), -cosine)
            weight = sine * cosine * 3.0 * math.pi * s**2
            total += weight * reflectance(row, (0.0, 0.0, -1.0), to_light, out)
    return total * step / 180


def _row(surface: Surface) -> np.ndarray:
    return surface_table({"": surface})[0]


share, alpha, axis_ = st.floats(0, 1), st.floats(0.05, 1), st.floats(-1, 1)


@st.composite
def surface(draw: st.DrawFn) -> Surface:
    """Any surface that gives back no more than it receives."""

    def lobe() -> dict[str, float]:
        return {
            "mirror_reflectance": draw(share),
            "alpha_along": draw(alpha),
            "alpha_across": draw(alpha),
        }

    along = draw(st.tuples(axis_, axis_, axis_))
    index = draw(st.floats(1, 2.5))
    coat, second = ClearCoat(alpha=draw(alpha), refractive_index=index), None
    if draw(st.booleans()):
        second = SecondLobe(share=draw(share), **lobe())
    assume(np.linalg.norm(along) > 0.01)
    try:
        return Surface(
            diffuse_albedo=draw(share),
            brushed_along=along,
            second_lobe=second,
            coat=draw(st.sampled_from([coat, None])),
            **lobe(),
        )
    except InputError:
        reject()


surfaces = surface() | st.sampled_from(list(SURFACES.values()))


@settings(max_examples=200, deadline=None)
@given(surfaces, st.floats(0, 85), st.floats(0, 360), st.floats(0, 85), st.floats(0, 360))
def test_light_and_eye_can_be_swapped(
    surface: Surface, light_t: float, light_a: float, eye_t: float, eye_a: float
) -> None:
    light, eye = _direction(light_t, light_a), _direction(eye_t, eye_a)
    there = reflectance(_row(surface), NORMAL, light, eye)
    back = reflectance(_row(surface), NORMAL, eye, light)
    assert there >= 0
    assert there == pytest.approx(back, rel=ROUNDING)


@settings(max_examples=60, deadline=None)
@given(surfaces, st.floats(0, 89), st.floats(0, 90))
def test_no_surface_reflects_more_than_it_receives(
    surface: Surface, polar_deg: float, azimuth_deg: float
) -> None:
    surface = replace(surface, brushed_along=(1.0, 0.0, 0.0))
    reflected = _reflected(_row(surface), _direction(polar_deg, azimuth_deg))
    assert reflected < 1.01
    # One integrates over directions, the other over facets.
    assert reflected == pytest.approx(surface.albedo(polar_deg, azimuth_deg), abs=0.02)


def test_a_smooth_mirror_returns_all_light() -> None:
    mirror = Surface(
        diffuse_albedo=0.0, mirror_reflectance=1.0, alpha_along=0.05, alpha_across=0.05
    )
    # A little is lost to masking, which single scattering does not give back.
    assert _reflected(_row(mirror), _direction(20.0, 0.0)) == pytest.approx(1.0, abs=0.02)


def test_a_mirror_is_brightest_where_it_mirrors() -> None:
    row = _row(replace(SURFACES["bare"], diffuse_albedo=0.0, alpha_along=0.05, alpha_across=0.05))
    values = [reflectance(row, NORMAL, _direction(30, 0), _direction(t, 180)) for t in range(90)]
    assert np.argmax(values) == pytest.approx(30, abs=1)


def test_a_lobe_at_normal_incidence_has_its_closed_form() -> None:
    """D = 1/(π·α²), G₂ = 1: f_r = F₀/(4π·α²)."""
    surface = Surface(
        diffuse_albedo=0.1,
        mirror_reflectance=0.5,
        alpha_along=0.2,
        alpha_across=0.3,
        second_lobe=SecondLobe(
            share=0.25, mirror_reflectance=0.1, alpha_along=0.4, alpha_across=0.4
        ),
        coat=ClearCoat(alpha=0.05),
    )
    below = 0.1 + 0.75 * 0.5 / 4 / 0.06 + 0.25 * 0.1 / 4 / 0.16
    expected = (below * 0.96**2 + 0.04 / 4 / 0.0025) / math.pi
    assert reflectance(_row(surface), NORMAL, NORMAL, NORMAL) == pytest.approx(expected, rel=1e-9)


@settings(max_examples=100, deadline=None)
@given(surfaces, st.floats(0, 85), st.floats(0, 360), st.floats(0, 85))
def test_a_coat_or_lobe_that_is_nothing_changes_nothing(
    surface: Surface, light_t: float, light_a: float, eye_t: float
) -> None:
    light, eye = _direction(light_t, light_a), _direction(eye_t, 0.0)
    try:
        plain = replace(surface, coat=None, second_lobe=None)
    except InputError:  # the coat took what is too much
        reject()
    lobe = SecondLobe(share=0.0, mirror_reflectance=0.9, alpha_along=0.1, alpha_across=0.1)
    nothing = replace(plain, coat=ClearCoat(alpha=0.3, refractive_index=1.0), second_lobe=lobe)
    expected = reflectance(_row(plain), NORMAL, light, eye)
    assert reflectance(_row(nothing), NORMAL, light, eye) == expected
    near = replace(plain, coat=ClearCoat(alpha=0.3, refractive_index=1.0 + 1e-6))
    assert reflectance(_row(near), NORMAL, light, eye) == pytest.approx(expected, rel=1e-3)


@settings(max_examples=100, deadline=None)
@given(surfaces, st.floats(0, 85), st.floats(0, 360), st.floats(0, 85), st.floats(0, 360))
def test_brushing_turns_with_its_direction(
    surface: Surface, light_t: float, light_a: float, eye_t: float, turn_deg: float
) -> None:
    t = math.radians(turn_deg)
    turned = replace(surface, brushed_along=(math.cos(t), math.sin(t), 0.0))
    unturned = replace(surface, brushed_along=(1.0, 0.0, 0.0))
    after = reflectance(
        _row(turned),
        NORMAL,
        _direction(light_t, light_a + turn_deg),
        _direction(eye_t, turn_deg),
    )
    before = reflectance(
        _row(unturned), NORMAL, _direction(light_t, light_a), _direction(eye_t, 0.0)
    )
    assert after == pytest.approx(before, rel=1e-6)


def test_brushing_is_projected_onto_the_surface() -> None:
    for tilted in ((1.0, 0.0, 0.5), (10.0, 0.0, -10.0)):
        row = _row(replace(SURFACES["brushed"], brushed_along=tilted))
        there = reflectance(row, NORMAL, _direction(40, 20), _direction(10, 250))
        flat = reflectance(
            TABLE[FINISHES.index("brushed")], NORMAL, _direction(40, 20), _direction(10, 250)
        )
        assert there == pytest.approx(flat, rel=ROUNDING)


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


def _grain_of_patch(**change: object) -> np.ndarray:
    x, y = np.meshgrid(np.arange(-60, 60, 0.5), np.arange(-60, 60, 0.5))
    row = _row(replace(SURFACES["bare"], **change))
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
    for direction, axis in (((1.0, 0.0, 0.0), 1), ((0.0, 2.0, 0.0), 0)):
        values = _grain_of_patch(grain_stretch=10.0, brushed_along=direction)[..., 0]
        along, across = np.diff(values, axis=axis).std(), np.diff(values, axis=1 - axis).std()
        assert across > 5 * along


def test_coarser_grain_is_the_same_at_a_larger_scale() -> None:
    fine, coarse = (_row(replace(SURFACES["bare"], grain_size_mm=size)) for size in (0.4, 0.8))
    assert grain(fine, (1.5, -2.0, 0.25)) == grain(coarse, (3.0, -4.0, 0.5))


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

"""Steps of fringes: gamma, flicker, swapped frames, motion; and the phase against a coordinate."""

import numpy as np
import pytest

from exposight.contradictions.steps import Steps, best_relation, check_phase, check_steps

_LINES, _LENGTH, _PERIODS, _SIZE = 24, 400, 16, 1024


def _coordinate():
    """(lines, length) px: a plane with waves."""
    u = np.arange(_LENGTH)
    return 80 + 2.1 * u + 6 * np.sin(u / 40) + 0.7 * np.arange(_LINES)[:, None]


def _steps(n, *, gamma=1.0, sign=1, offset=0.0, noise=1.0, order=None, gains=None, light=1.0):
    phase = 2 * np.pi * _PERIODS * _coordinate() / _SIZE
    shifts = 360.0 * np.arange(n) / n
    angles = sign * phase - np.radians(shifts)[:, None, None] + 2 * np.pi * offset
    samples = 20 + 170 * light * (0.5 + 0.48 * np.cos(angles)) ** gamma
    if gains is not None:
        samples = samples * np.asarray(gains)[:, None, None]
    if order is not None:
        samples = samples[list(order)]
    samples = samples + np.random.default_rng(n).normal(0, noise, samples.shape)
    return Steps(
        samples=np.rint(samples),
        usable=np.ones((_LINES, _LENGTH), bool),
        shifts_deg=shifts,
        frames=tuple(range(5, 5 + n)),
        periods=_PERIODS,
        size=_SIZE,
        name="the fringe",
    )


def _phase(steps):
    shifts = np.radians(steps.shifts_deg)
    design = np.column_stack([np.ones_like(shifts), np.cos(shifts), np.sin(shifts)])
    _, cosine, sine = np.tensordot(np.linalg.pinv(design), steps.samples, axes=1)
    return np.arctan2(sine, cosine) / (2 * np.pi)


@pytest.mark.parametrize("n", [3, 4, 5, 8])
@pytest.mark.parametrize("light", [1.0, 0.15])
def test_sinusoids_have_no_contradiction_bright_or_dark(n, light):
    assert not list(check_steps(_steps(n, light=light, noise=2.0)))


@pytest.mark.parametrize("n", [3, 4, 5])
@pytest.mark.parametrize("gamma", [1.5, 2.2, 0.5])
def test_gamma_is_named_with_its_value(n, gamma):
    (found,) = check_steps(_steps(n, gamma=gamma))
    named = float(found.explanation.split("gamma ")[1].split()[0])
    assert named == pytest.approx(gamma, abs=0.3)


@pytest.mark.parametrize(("n", "swap"), [(4, (0, 1)), (5, (1, 3)), (8, (2, 5))])
def test_two_frames_that_changed_places_are_an_error(n, swap):
    order = list(range(n))
    order[swap[0]], order[swap[1]] = swap[1], swap[0]
    (found,) = check_steps(_steps(n, order=order))
    assert found.is_error
    if n > 4:  # of four steps, other pairs fit as well
        assert f"frames {5 + swap[0]} and {5 + swap[1]}" in found.explanation


@pytest.mark.parametrize("n", [3, 4, 5, 8])
def test_a_brighter_frame_is_named(n):
    gains = np.ones(n)
    gains[2] = 1.08
    (found,) = check_steps(_steps(n, gains=gains))
    assert "frame 7 is 8 % brighter" in found.found


@pytest.mark.parametrize("n", [4, 8])
def test_clipping_below_full_scale_is_an_error_that_names_the_level(n):
    steps = _steps(n)
    shade = np.linspace(0.3, 1.0, _LINES)[:, None]  # a third of the lines reaches the level
    clipped = np.minimum(np.rint(steps.samples * shade), 130)
    (found,) = check_steps(steps._replace(samples=clipped))
    assert found.is_error
    assert "saturation_level = 130" in found.explanation


def test_a_fringe_that_moves_between_frames_is_named():
    steps = _steps(5)
    moved = steps.samples.copy()
    moved[3:] = np.roll(moved[3:], 9, axis=2)
    (found,) = check_steps(steps._replace(samples=moved))
    assert "moved" in found.explanation


@pytest.mark.parametrize("n", [3, 4])
def test_a_phase_that_follows_the_coordinate_has_no_contradiction(n):
    steps = _steps(n)
    coordinate = _coordinate() + np.random.default_rng(1).normal(0, 2, steps.usable.shape)
    assert check_phase(coordinate.ravel(), _phase(steps).ravel(), steps, "code") is None


def test_steps_that_run_the_other_way_are_an_error_with_the_shifts_that_fit():
    steps = _steps(4, sign=-1)
    found = check_phase(_coordinate().ravel(), _phase(steps).ravel(), steps, "code")
    assert found.is_error
    assert "reversed = true" in found.explanation
    assert "[0.0, -90.0, -180.0, 90.0]" in found.explanation


def test_the_hint_for_steps_that_are_said_to_be_reversed_is_to_say_that_no_more():
    steps = _steps(4)
    said = steps._replace(shifts_deg=[-s for s in steps.shifts_deg], is_reversed=True)
    found = check_phase(_coordinate().ravel(), -_phase(steps).ravel(), said, "code")
    assert found.is_error
    assert "reversed = false" in found.explanation
    # Written beside reversed = true they are -(0, 90, 180, 270) as well.
    assert "[0.0, -90.0, -180.0, 90.0]" in found.explanation


def test_shifts_for_an_offset_are_written_as_reversed_as_they_are():
    steps = _steps(4, offset=0.25)
    said = steps._replace(is_reversed=True)  # of shifts_deg = written
    found = check_phase(_coordinate().ravel(), _phase(steps).ravel(), said, "code")
    assert "[90.0, 0.0, -90.0, " in found.explanation


def test_a_constant_offset_is_named_in_pixels_and_in_shifts():
    steps = _steps(4, offset=0.25)
    found = check_phase(_coordinate().ravel(), _phase(steps).ravel(), steps, "code")
    assert found.is_error
    assert "+16.0 px" in found.found
    assert "[-90.0, 0.0, 90.0, -180.0]" in found.explanation


def test_another_number_of_periods_is_named():
    steps = _steps(4)._replace(periods=20)
    found = check_phase(_coordinate().ravel(), _phase(steps).ravel(), steps, "code")
    assert found.is_error
    assert "16 periods" in found.explanation


def test_no_relation_at_all_is_an_error_unless_noise_explains_it():
    steps = _steps(4)
    phase = np.random.default_rng(0).random(steps.usable.size)
    found = check_phase(_coordinate().ravel(), phase, steps, "code")
    assert found.is_error
    assert "belong together" in found.explanation
    assert check_phase(_coordinate().ravel(), phase, steps, "code", expected=0.1) is None


@pytest.mark.parametrize("sign", [1, -1])
def test_the_number_of_periods_is_found_with_its_sign(sign):
    steps = _steps(5, sign=sign)
    found = best_relation(_coordinate().ravel(), _phase(steps).ravel(), 30, _SIZE)
    assert found.periods == pytest.approx(sign * _PERIODS, abs=0.2)
    assert found.coherence > 0.95

"""Leave-one-out predictions in closed form against doing it."""

import numpy as np
import pytest

from exposight.gp import ChangePoint, Exponential, GaussianProcess
from exposight.gp.factor import Factor
from exposight.statistics import calibration

# Two dozen observations, well conditioned.
ROUNDING = 1e-10
NOISE = 0.05
GATED = Exponential(variance=1.4, length_scales=(0.8, 1.5), dims=(0, 1)) * ChangePoint(
    dim=0, minimum=-1.0
)


@pytest.fixture
def process():
    rng = np.random.default_rng(9)
    x = rng.normal(size=(25, 2))
    x[0, 0] = -2.0  # outside the gate
    return GaussianProcess.condition(GATED, NOISE, x, np.sin(x[:, 0]) + 0.2 * rng.normal(size=25))


def refitted(process):
    """Every row predicted by a process without it."""
    x, y = process.x, process.y
    predictions = []
    for row in range(len(y)):
        rest = np.arange(len(y)) != row
        without = GaussianProcess.condition(GATED, NOISE, x[rest], y[rest])
        predictions.append(without.predict(x[row : row + 1], include_noise=True))
    return (
        np.concatenate([own.mean for own in predictions]),
        np.concatenate([own.std for own in predictions]),
    )


@pytest.mark.parametrize("with_inverse", [True, False])
def test_leaving_one_out_is_as_predicting_without_it(process, with_inverse, monkeypatch):
    if not with_inverse:
        monkeypatch.setattr(Factor, "inverse", None)
    left_out = process.leave_one_out()
    mean, std = refitted(process)
    np.testing.assert_allclose(left_out.mean, mean, atol=ROUNDING)
    np.testing.assert_allclose(left_out.std, std, atol=ROUNDING)


def test_observations_of_the_prior_are_predicted_with_the_right_confidence():
    rng = np.random.default_rng(10)
    x = rng.uniform(-1.0, 3.0, size=(400, 2))
    covariance = GATED.value(x, x) + NOISE * np.eye(400)
    y = np.linalg.cholesky(covariance) @ rng.normal(size=400)
    left_out = GaussianProcess.condition(GATED, NOISE, x, y).leave_one_out()
    own = calibration(y, left_out.mean, left_out.std)
    # three standard errors of a share of 400
    assert own.within_1sigma == pytest.approx(0.683, abs=0.07)
    assert own.within_2sigma == pytest.approx(0.954, abs=0.03)
    assert own.within_3sigma > 0.98


def test_outside_the_gate_there_is_noise_alone(process):
    left_out = process.leave_one_out()
    assert left_out.mean[0] == 0.0
    assert left_out.std[0] == pytest.approx(np.sqrt(NOISE))

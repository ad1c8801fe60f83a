"""Evaluations of any predictor: bands, chances, distributions, and rows that are scored apart."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import norm

from exposight.models import Prediction, Predictor, Provenance, evaluate


@dataclass(frozen=True, kw_only=True, eq=False)
class Formula(Predictor):
    """Says what it was made to say of each row."""

    prediction: Prediction

    def predict_frame(self, frame):
        return self.prediction


def model(table, mean, std, target="p_norm", **changes):
    given = Prediction(
        mean=np.broadcast_to(mean, len(table)).astype(float),
        std=np.full(len(table), std),
        inside=np.ones(len(table), dtype=bool),
        **changes,
    )
    return Formula(
        name="formula",
        title="",
        target=target,
        inputs=("x_mm",),
        provenance=Provenance.of(table),
        prediction=given,
    )


@pytest.fixture
def rows(table):
    return table.measured()


def test_the_chance_is_judged_where_the_need_is_known(rows):
    observed = rows.array(["p_norm"])[:, 0]
    evaluation = evaluate(model(rows, observed + 0.1, 0.2), rows)
    chance = norm.sf((0.75 - observed - 0.1) / 0.2)
    np.testing.assert_allclose(evaluation.chance, chance, atol=1e-9)
    score = evaluation.probability_score(np.ones(len(observed), dtype=bool))
    assert score.brier == pytest.approx(np.mean((chance - (observed >= 0.75)) ** 2))
    edge = (observed > 0.03) & (observed < 0.97)
    assert score.n_edge == edge.sum()
    assert score.coverage_edge == 1.0
    assert score.log_score == pytest.approx(-norm.logpdf(0.1, 0.0, 0.21), abs=1e-6)
    assert sum(group.n for group in evaluation.reliability) == len(observed)


def test_exposure_times_have_relative_errors_and_log_normal_bands(rows):
    times = rows.array(["exposure_ms"])[:, 0]
    low, high = 1.1 * times / 1.21, 1.1 * times * 1.21
    given = model(rows, 1.1 * times * np.exp(0.5 * np.log(1.1) ** 2), 1.0, "exposure_ms")
    prediction = replace(given.prediction, low=low, high=high)
    evaluation = evaluate(replace(given, prediction=prediction), rows)
    np.testing.assert_allclose(evaluation.inner_band, [times, 1.21 * times], rtol=1e-9)
    score = evaluation.probability_score(np.ones(len(times), dtype=bool))
    assert score.median_relative_error == pytest.approx(0.1, abs=0.006)
    assert score.brier is None
    assert evaluation.chance is None
    assert evaluation.reliability == ()


def test_known_and_unseen_features_are_apart(rows):
    names = rows.names("feature")
    first = names[0]
    known = rows.where(names == first)
    evaluation = evaluate(replace(model(rows, 0.5, 0.5), provenance=Provenance.of(known)), rows)
    np.testing.assert_array_equal(evaluation.unseen, names != first)
    assert set(evaluation.selections) == {"all", "known", "unseen"}
    assert set(evaluate(model(rows, 0.5, 0.5), rows).selections) == {"all"}
    nobody = replace(Provenance.of(rows), features=())
    assert evaluate(replace(model(rows, 0.5, 0.5), provenance=nobody), rows).unseen is None


@pytest.mark.parametrize(
    ("low", "high", "quantiles"),
    [
        (None, None, (0.4, 0.5, 0.6)),
        (0.25, 1.0, (0.5 / 2**0.5, 0.5, 0.5 * 2**0.5)),
        (0.0, 0.6, (0.25, 0.5, 0.55)),
    ],
)
def test_a_band_stands_for_a_distribution(low, high, quantiles):
    shape = {
        name: np.array([value])
        for name, value in (("low", low), ("high", high))
        if value is not None
    }
    prediction = Prediction(
        mean=np.array([0.5]), std=np.array([0.1]), inside=np.array([True]), **shape
    )
    levels = norm.cdf([-1.0, 0.0, 1.0])
    np.testing.assert_allclose(prediction.quantiles(levels)[:, 0], quantiles)
    for level, value in zip(levels, quantiles, strict=True):
        assert prediction.chance(value)[0] == pytest.approx(1.0 - level)

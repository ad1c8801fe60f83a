"""The law by which a fit's time is foretold."""

import time

import numpy as np
import pytest

from exposight.gp import RationalQuadratic, cost
from exposight.gp.likelihood import MarginalLikelihood

SIZES = {"shard_size": 2000, "communication": 1000}


def test_the_law_is_quadratic_and_cubic(monkeypatch):
    monkeypatch.setattr(cost, "_law", lambda: (1e-8, 1e-10))
    assert cost.fit_seconds(1000, starts=1) == pytest.approx(35 * (0.01 + 0.1))
    assert cost.fit_seconds(1000) == 3 * cost.fit_seconds(1000, starts=1)


def test_a_committee_grows_with_its_rows_alone(monkeypatch):
    monkeypatch.setattr(cost, "_law", lambda: (1e-8, 1e-10))
    small, large = (cost.committee_seconds(n, search_shards=8, **SIZES) for n in (51_000, 101_000))
    assert large - small == pytest.approx(25 * cost.fit_seconds(2000, starts=1) / 35)
    assert large < cost.fit_seconds(101_000) / 1000


def test_the_law_foretells_an_evaluation():
    kernel = RationalQuadratic(variance=1.0, length_scales=(1.0,) * 4, alpha=1.0, dims=(0, 1, 2, 3))
    x = np.random.default_rng(1).standard_normal((1200, 4))
    likelihood = MarginalLikelihood(x, x[:, 0], active=np.ones(len(x), dtype=np.bool_))
    taken = []
    for _ in range(3):
        began = time.thread_time()
        likelihood.value_and_gradient(kernel, 0.1)
        taken.append(time.thread_time() - began)
    assert 0.1 < 35 * min(taken) / cost.fit_seconds(len(x), starts=1) < 10.0

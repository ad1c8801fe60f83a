"""How long a fit takes, known before it begins: a law measured on this machine."""

import time
from functools import cache

import numpy as np

from exposight.gp.kernels import RationalQuadratic
from exposight.gp.likelihood import MarginalLikelihood

# Of the likelihood for one start; measured over the paper's models.
_EVALUATIONS = 35
# Observations at which the law's two terms are measured, in a tenth of a second.
_FEW, _MANY = 200, 600


def fit_seconds(observations: int, *, starts: int = 3) -> float:
    """Return about how many CPU seconds an exact fit takes: its evaluations at a n² + b n³."""
    by_pair, by_cube = _law()
    return starts * _EVALUATIONS * (by_pair * observations**2 + by_cube * observations**3)


def committee_seconds(
    observations: int, *, shard_size: int, communication: int, search_shards: int, starts: int = 3
) -> float:
    """Return about how many CPU seconds `fit_committee` takes: the first fit, search, experts."""
    shards = max(1, -(-(observations - communication) // shard_size))
    searched = min(shards, search_shards) * fit_seconds(shard_size, starts=1)
    experts = shards * fit_seconds(shard_size, starts=1) / _EVALUATIONS
    return fit_seconds(communication, starts=starts) + searched + experts


@cache
def _law() -> tuple[float, float]:
    """Measure seconds of an evaluation for each pair of observations, and for each three."""
    kernel = RationalQuadratic(variance=1.0, length_scales=(1.0,) * 4, alpha=1.0, dims=(0, 1, 2, 3))
    x = np.random.default_rng(0).standard_normal((_MANY, 4))

    def seconds(n: int) -> float:
        likelihood = MarginalLikelihood(x[:n], x[:n, 0], active=np.ones(n, dtype=np.bool_))
        likelihood.value_and_gradient(kernel, 0.1)  # compiled, and in the caches
        taken = []
        for _ in range(3):  # other work slows single ones
            began = time.thread_time()
            likelihood.value_and_gradient(kernel, 0.1)
            taken.append(time.thread_time() - began)
        return min(taken)

    few, many = seconds(_FEW), seconds(_MANY)
    by_cube = max(0.0, (many / _MANY**2 - few / _FEW**2) / (_MANY - _FEW))
    return max(0.0, few / _FEW**2 - by_cube * _FEW), by_cube

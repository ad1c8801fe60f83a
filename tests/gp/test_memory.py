"""Matrices that memory does not hold are refused before they are made, with the facts."""

import numpy as np
import pytest

from exposight.errors import OutOfMemoryError
from exposight.gp import Committee, GaussianProcess, SquaredExponential, fit, memory

KERNEL = SquaredExponential(variance=1.0, length_scales=1.0, dims=(0,))
ROWS = 4000


@pytest.fixture
def _little_memory(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 120_000_000)


@pytest.fixture
def observations():
    x = np.random.default_rng(1).uniform(0.0, 50.0, size=(ROWS, 1))
    return x, np.sin(x[:, 0])


@pytest.mark.usefixtures("_little_memory")
def test_a_fit_too_large_is_refused(observations):
    with pytest.raises(OutOfMemoryError, match=r"4000 observations takes 0.1 GB .* take a committ"):
        fit(KERNEL, *observations, rng=np.random.default_rng(1))


@pytest.mark.usefixtures("_little_memory")
def test_a_process_too_large_is_refused(observations):
    with pytest.raises(OutOfMemoryError, match=r"4000 observations takes 0.1 GB of memory, and"):
        GaussianProcess.condition(KERNEL, 0.1, *observations)


@pytest.mark.usefixtures("_little_memory")
def test_a_committee_too_large_is_refused(observations):
    shard = np.repeat([-1, 0], [100, ROWS - 100])
    with pytest.raises(OutOfMemoryError, match="committee of 1 experts on 4000 observations"):
        Committee.from_shards(KERNEL, 0.1, *observations, shard)


@pytest.mark.usefixtures("_little_memory")
def test_a_committee_of_small_shards_takes_memory_in_proportion_to_them(observations):
    shard = np.r_[np.full(100, -1), np.arange(ROWS - 100) // 325]
    assert Committee.from_shards(KERNEL, 0.1, *observations, shard).experts == 12


def test_little_is_never_refused(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 0)
    memory.check_memory(1000, "something small", "nothing")


def test_nothing_is_refused_where_nothing_tells(monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    memory.check_memory(10**15, "something large", "nothing")


def test_a_container_limits_memory(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemTotal: 900 kB\nMemAvailable:   700 kB\n")
    (tmp_path / "memory.max").write_text("500000\n")
    (tmp_path / "memory.stat").write_text("anon 100000\nfile 300000\n")
    monkeypatch.setattr(memory, "_MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_CONTAINER", tmp_path)
    assert memory.available_bytes() == 400_000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.available_bytes() == 700 * 1024

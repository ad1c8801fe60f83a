"""A kernel of another package: trained by workers, in a committee, kept in a file."""

import importlib
import subprocess
import sys

import numpy as np
import pytest

from exposight.models import ModelSpecification, Training, load_model, save_model, train_all

MODULE = """
from dataclasses import dataclass

import numpy as np

from exposight.gp import Leaf, Quantity, register_kernel


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Saturation(Leaf):
    variance: float = 1.0
    length_scale: float = 1.0
    dim: int = 0
    fixed: tuple[str, ...] = ()

    type_name = "another_package/saturation"
    quantities = {"variance": Quantity.VARIANCE, "length_scale": Quantity.LENGTH_SCALE}

    def curve(self, x):
        return np.log1p(x[:, self.dim] / self.length_scale)

    def fill(self, x, y, out):
        np.outer(self.variance * self.curve(x), self.curve(y), out)

    def derivatives(self, x, y, weights):
        u, v = self.curve(x), self.curve(y)
        slopes = np.outer(np.expm1(-u), v) + np.outer(u, np.expm1(-v))
        return self.variance * np.array([u @ weights @ v, np.sum(weights * slopes)])

    def prior_variance(self, x):
        return self.variance * self.curve(x) ** 2
"""


@pytest.fixture
def specification(tmp_path, monkeypatch):
    (tmp_path / "another_package.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    kernel = importlib.import_module("another_package").Saturation()
    return ModelSpecification(
        name="saturation", title="a curve", target="exposure_ms", inputs=("i_avg",), kernel=kernel
    )


def test_it_is_fitted(specification, table):
    model = Training(specification=specification, table=table, seed=1, restarts=1).run()
    # the synthetic cell's exposure times are proportional to brightness: log(1 + x/l) ≈ x/l
    assert model.process.kernel.length_scale > 1000.0
    assert [each.name for each in model.hyperparameters()] == [
        "another_package/saturation.variance",
        "another_package/saturation.length_scale",
        "noise_variance",
    ]


@pytest.mark.slow
def test_worker_processes_train_it(specification, table):
    settings = {"seed": 1, "restarts": 1}
    here, there = (
        train_all((specification, specification), table, workers=workers, **settings)
        for workers in (1, 2)
    )
    assert [model.summary for model in there] == [model.summary for model in here]


def test_a_committee_of_it_is_kept_in_a_file(specification, make_table, tmp_path):
    table, path = make_table(300), tmp_path / "saturation.exposight-model"
    model = Training(
        specification=specification, table=table, seed=1, restarts=1, committee_rows=120
    ).run()
    assert model.experts > 1
    save_model(path, model)
    again = load_model(path)
    assert again.process.kernel == model.process.kernel
    np.testing.assert_array_equal(again.predict(table).mean, model.predict(table).mean)


@pytest.mark.slow
def test_a_program_that_lacks_its_module_is_told_which(specification, table, tmp_path):
    path = tmp_path / "saturation.exposight-model"
    save_model(path, Training(specification=specification, table=table, seed=1, restarts=1).run())
    script = "import sys, exposight; exposight.load_model(sys.argv[1])"
    run = subprocess.run(
        [sys.executable, "-c", script, path], capture_output=True, text=True, check=False
    )
    assert "first import the module another_package that defines it" in run.stderr

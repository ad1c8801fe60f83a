"""The models are the paper's: names, inputs, kernels, and the rows that each learns from."""

import numpy as np
import pytest

from exposight.errors import InputError
from exposight.gp import Exponential, Linear, Product, RationalQuadratic
from exposight.models import (
    EXPOSURE_TIME_MODELS,
    MODELS,
    P_NORM_MIN,
    QUALITY_MODELS,
    model_named,
)
from exposight.quantities import QUANTITIES

SIX = ("i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")

PAPER = {
    "q_k1": ("i_avg",),
    "q_k2": ("i_avg", "z_mm"),
    "q_k3": ("i_avg", "z_mm", "x_mm"),
    "q_k4": ("i_avg", "z_mm", "x_mm", "y_mm"),
    "q_k6": ("i_avg", "z_mm", "x_mm", "y_mm", "w_deg", "p_deg"),
    "e_k1": ("i_avg",),
    "e_k2": ("i_avg", "z_mm"),
    "e_k3": ("i_avg", "z_mm", "x_mm"),
    "e_k4": ("i_avg", "z_mm", "x_mm", "y_mm"),
    "e_k6_plus": SIX,
    "e_k6_star": SIX,
    "e_k6": SIX,
    "e_k6_lin": SIX,
}
"""Tables 2 and 3, and Sects. 3.3.4 to 3.4.9."""

quality_models = pytest.mark.parametrize("model", QUALITY_MODELS, ids=lambda model: model.name)
exposure_models = pytest.mark.parametrize(
    "model", EXPOSURE_TIME_MODELS, ids=lambda model: model.name
)


def test_names_and_inputs_are_the_papers():
    assert [(model.name, model.inputs) for model in MODELS] == list(PAPER.items())


def test_quality_models_predict_p_norm_from_all_observations():
    assert {(model.target, model.p_norm_min) for model in QUALITY_MODELS} == {("p_norm", None)}


def test_exposure_time_models_predict_it_from_observations_of_quality():
    kinds = {(model.target, model.p_norm_min) for model in EXPOSURE_TIME_MODELS}
    assert kinds == {("exposure_ms", 0.75)}
    assert P_NORM_MIN == 0.75


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_every_kernel_reads_every_input_and_nothing_else(model):
    assert model.kernel.columns == tuple(range(len(model.inputs)))


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_every_variable_has_a_unit(model):
    assert set(model.inputs) | {model.target} <= set(QUANTITIES)


@quality_models
def test_quality_kernels_are_rational_quadratics_with_a_length_scale_an_input(model):
    assert isinstance(model.kernel, Product)
    smooth, *gates = model.kernel.factors
    assert isinstance(smooth, RationalQuadratic)
    assert len(smooth.length_scales) == len(model.inputs)
    assert [(gate.dim, gate.minimum, gate.maximum) for gate in gates] == [
        (0, 10.0, None),
        (0, None, 255.0),
    ]


@pytest.mark.parametrize("name", ["e_k1", "e_k2", "e_k3", "e_k4", "e_k6_plus"])
def test_exponential_kernels_have_one_length_scale(name):
    kernel = model_named(name).kernel
    assert isinstance(kernel, Exponential)
    assert len(kernel.length_scales) == 1


def test_the_starred_kernel_has_a_length_scale_an_input():
    kernel = model_named("e_k6_star").kernel
    assert isinstance(kernel, Exponential)
    assert len(kernel.length_scales) == 6


def test_the_product_kernel_separates_brightness_from_the_pose():
    brightness, pose = model_named("e_k6").kernel.factors
    assert (brightness.columns, pose.columns) == ((0,), (1, 2, 3, 4, 5))
    assert (len(brightness.length_scales), len(pose.length_scales)) == (1, 5)


def test_the_product_kernel_has_one_free_variance():
    names = [parameter.name for parameter in model_named("e_k6").kernel.free_parameters]
    assert sum("variance" in name for name in names) == 1


def test_the_linear_kernel_has_a_variance_an_input():
    kernel = model_named("e_k6_lin").kernel
    assert isinstance(kernel, Linear)
    assert len(kernel.variances) == 6


def test_a_model_is_found_by_its_name():
    assert [model_named(name).name for name in PAPER] == list(PAPER)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(
        InputError, match=r"no model 'q_k5'; expected one of q_k1, q_k2, .*e_k6_lin"
    ):
        model_named("q_k5")


@exposure_models
def test_exposure_time_models_learn_from_p_norm_of_at_least_three_quarters(model, table):
    qualities = model.rows(table).array(["p_norm"])[:, 0]
    everything = table.array(["p_norm"])[:, 0]
    assert 0 < len(qualities) < len(table)
    np.testing.assert_array_equal(qualities, everything[everything >= 0.75])


@quality_models
def test_quality_models_learn_from_dark_observations_too(model, table):
    assert len(model.rows(table)) == len(table)


def test_data_are_the_inputs_in_order_and_the_target(table):
    x, y = model_named("q_k3").data(table)
    np.testing.assert_array_equal(x, table.array(["i_avg", "z_mm", "x_mm"]))
    np.testing.assert_array_equal(y, table.array(["p_norm"])[:, 0])

"""Kernels that exposight does not know: registered, described, and refused with the remedy."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from exposight.errors import InputError
from exposight.gp import (
    Kernel,
    Leaf,
    Matern32,
    SquaredExponential,
    kernel_from_dict,
    register_kernel,
)


@register_kernel
@dataclass(frozen=True, kw_only=True)
class Masked(Leaf):
    """A kernel whose fields are of every sort that a description may hold."""

    inner: Kernel
    knots: tuple[tuple[float, ...], ...] = ((0.0, 1.0), (2.0,))
    label: str = "all"
    strict: bool | None = None
    type_name: ClassVar[str] = "tests/masked"

    @property
    def columns(self):
        return self.inner.columns

    def fill(self, x, y, out):
        self.inner.fill(x, y, out)

    def derivatives(self, x, y, weights):
        return np.empty(0)

    def prior_variance(self, x):
        return self.inner.prior_variance(x)


INNER = SquaredExponential(variance=2.0, length_scales=1.0, dims=(0,))
MASKED = Masked(inner=INNER)


def test_every_field_that_json_can_hold_comes_back():
    tree = MASKED * INNER + replace(MASKED, label="one", strict=True)
    assert kernel_from_dict(tree.to_dict()) == tree


def test_numbers_of_numpy_are_described_as_plain_ones():
    description = replace(MASKED, knots=((np.float64(1.5), np.int64(3)),)).to_dict()
    assert [type(value) for value in description["knots"][0]] == [float, int]


def test_a_field_that_no_file_can_hold_is_named():
    with pytest.raises(InputError, match=r"Masked\.knots must hold a number, text, .* got ndarray"):
        replace(MASKED, knots=np.ones(2)).to_dict()


def test_a_kernel_that_is_not_registered_is_not_described():
    @dataclass(frozen=True, kw_only=True)
    class Steeper(Matern32):
        """It has the type name of another kernel."""

    kernel = Steeper(variance=1.0, length_scales=1.0, dims=(0,))
    with pytest.raises(InputError, match=r"Steeper cannot be described.*register_kernel"):
        (kernel * INNER).to_dict()
    with pytest.raises(InputError, match="type_name of its own, got 'matern32'"):
        register_kernel(Steeper)


def test_a_kernel_that_is_no_dataclass_is_not_registered():
    class Plain:
        type_name = "tests/plain"

    with pytest.raises(InputError, match="Plain must be a frozen dataclass"):
        register_kernel(Plain)


def test_an_unknown_kernel_is_refused_with_the_module_to_import():
    description = {**MASKED.to_dict(), "type": "tests/unknown", "module": "their.kernels"}
    with pytest.raises(InputError, match=r"first import the module their\.kernels that defines it"):
        kernel_from_dict(description)
    with pytest.raises(InputError, match="first import the script that defines it"):
        kernel_from_dict({**description, "module": "__main__"})


def test_a_description_that_a_kernel_cannot_be_made_of_is_refused():
    with pytest.raises(InputError, match="of type 'tests/masked' makes no sense"):
        kernel_from_dict({"type": "sum", "terms": [{**MASKED.to_dict(), "inner": 3.0}] * 2})

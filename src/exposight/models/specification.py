"""What a model is before it is trained, and the paper's models (Sects. 3.3 and 3.4, Tables 2, 3).

The quality models ᵠGP predict p_norm from brightness and position and learn from every measured
observation. They share one base kernel (Eq. 9): a rational quadratic with a length scale for each
input, switched off below i_avg = 10 and above 255 by the change-point kernels, where the prediction
is exactly 0.

The exposure-time models ᵉGP predict the exposure that yields a wanted brightness, and learn only
from observations of sufficient quality, p_norm ≥ 0.75 (Sect. 3.4.1). Their kernels are the
exponential ones of Eq. 18 in GPy's form σ²·exp(−r), which Table 8's values need; see
`exposight.gp.Exponential`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from exposight.errors import InputError, ObservationError, did_you_mean
from exposight.gp import ChangePoint, Exponential, Kernel, Linear, RationalQuadratic
from exposight.models.predictor import input_array
from exposight.observing import ObservationTable

I_AVG_MIN = 10.0
"""Below this mean grey value there are no points (Sect. 3.3.3 and Fig. 10)."""
I_AVG_MAX = 255.0
"""Full scale of the 8-bit range (Sect. 3.3.3)."""

P_NORM_MIN = 0.75
"""Least quality to learn an exposure time from (Sect. 3.4.1)."""


TargetScale: TypeAlias = Literal["linear", "log"]


@dataclass(frozen=True, kw_only=True)
class ModelSpecification:
    """A Gaussian-process model, untrained: one of the paper's, or one's own.

    Parameters
    ----------
    name : str
        As in the paper, written plainly: ``q_k4`` is ᵠk₄, ``e_k6_star`` is ᵉk₆*.
    title : str
        What it is, for people.
    target : str
        The column it predicts: ``p_norm``, ``exposure_ms`` or any other numeric one.
    inputs : tuple of str
        The columns it reads, in the order of the kernel's dimensions.
    kernel : Kernel
        The kernel's form; training finds its hyperparameters and ignores their values here.
    p_norm_min : float or None
        Learn only from observations of at least this quality (Sect. 3.4.1); None for all.
    source : str
        Where it is defined, for instance in the paper.
    target_scale : {"linear", "log"}
        Scale of the target on which the process works. On that of its natural logarithm errors are
        relative: predictions are always above 0, and their bands wider above than below.
    """

    name: str
    title: str
    target: str
    inputs: tuple[str, ...]
    kernel: Kernel
    p_norm_min: float | None = None
    source: str = ""
    target_scale: TargetScale = "linear"

    def __post_init__(self) -> None:
        if self.target_scale not in get_args(TargetScale):
            msg = (
                f"{self.name}: target_scale must be one of {', '.join(get_args(TargetScale))}, got "
                f"{self.target_scale!r}"
            )
            raise InputError(msg)

    def rows(self, table: ObservationTable) -> ObservationTable:
        """Return the measured rows that the model learns from and is evaluated on."""
        measured = table.measured()
        return measured if self.p_norm_min is None else measured.with_quality(self.p_norm_min)

    def data(self, table: ObservationTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (n, d) inputs and (n,) targets on `target_scale`, of all of a table's rows.

        Raises
        ------
        ObservationError
            If a column is missing, or has no value in some row, or one without a logarithm.
        """
        table.array((*self.inputs, self.target))  # names a column that is missing
        inputs = input_array(self.name, table.frame.select(self.inputs))
        targets = input_array(self.name, table.frame.select(self.target))[:, 0]
        if self.target_scale == "linear":
            return inputs, targets
        if len(targets) and targets.min() <= 0.0:
            msg = (
                f"{self.name} learns the logarithm of {self.target}, which must be above 0, got "
                f"{targets.min():g} ({np.count_nonzero(targets <= 0.0)} of {len(targets)} rows); "
                "leave such rows out, or take target_scale='linear'"
            )
            raise ObservationError(msg)
        return inputs, np.log(targets)


def base_kernel(n_inputs: int) -> Kernel:
    """Return the form k_RQ · k_CP,min · k_CP,max (Eq. 9); the first input is i_avg."""
    return (
        RationalQuadratic(
            variance=1.0,
            length_scales=(1.0,) * n_inputs,
            alpha=1.0,
            dims=tuple(range(n_inputs)),
        )
        * ChangePoint(dim=0, minimum=I_AVG_MIN)
        * ChangePoint(dim=0, maximum=I_AVG_MAX)
    )


def isotropic_kernel(n_inputs: int) -> Kernel:
    """Return the form of the exponential kernel (Eq. 18): one length scale for all inputs."""
    return Exponential(variance=1.0, length_scales=(1.0,), dims=tuple(range(n_inputs)))


def ard_kernel(n_inputs: int) -> Kernel:
    """Return the exponential kernel with a length scale for each input (ᵉk₆*, Sect. 3.4.8)."""
    dims = tuple(range(n_inputs))
    return Exponential(variance=1.0, length_scales=(1.0,) * n_inputs, dims=dims)


def product_kernel(n_inputs: int) -> Kernel:
    """Return the product of a kernel on i_avg and one on the pose (Eq. 21).

    Only the product of the two variances matters, so that of the pose is kept at 1.
    """
    brightness = Exponential(variance=1.0, length_scales=(1.0,), dims=(0,))
    pose = Exponential(
        variance=1.0,
        length_scales=(1.0,) * (n_inputs - 1),
        dims=tuple(range(1, n_inputs)),
        fixed=("variance",),
    )
    return brightness * pose


def linear_kernel(n_inputs: int) -> Kernel:
    """Return the linear kernel with a variance for each input (ᵉk₆ˡⁱⁿ, Sect. 3.4.9)."""
    return Linear(variances=(1.0,) * n_inputs, dims=tuple(range(n_inputs)))


_NESTED = ("i_avg", "z_mm", "x_mm", "y_mm", "w_deg", "p_deg")
_SIX = ("i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")


def _paper_model(
    name: str, title: str, inputs: tuple[str, ...], kernel: Callable[[int], Kernel], source: str
) -> ModelSpecification:
    quality = name.startswith("q_")
    return ModelSpecification(
        name=name,
        title=f"{'quality' if quality else 'exposure time'}, {title}",
        target="p_norm" if quality else "exposure_ms",
        inputs=inputs,
        kernel=kernel(len(inputs)),
        p_norm_min=None if quality else P_NORM_MIN,
        source=source,
    )


QUALITY_MODELS = (
    _paper_model("q_k1", "1D", _NESTED[:1], base_kernel, "Sect. 3.3.4, Eq. 11"),
    _paper_model("q_k2", "2D", _NESTED[:2], base_kernel, "Sect. 3.3.5, Eq. 14"),
    _paper_model("q_k3", "3D", _NESTED[:3], base_kernel, "Sect. 3.3.5"),
    _paper_model("q_k4", "4D", _NESTED[:4], base_kernel, "Sect. 3.3.6, Eq. 15"),
    _paper_model("q_k6", "6D", _NESTED, base_kernel, "Sect. 3.3.7"),
)

EXPOSURE_TIME_MODELS = (
    _paper_model("e_k1", "1D", _NESTED[:1], isotropic_kernel, "Sect. 3.4.5, Eq. 19"),
    _paper_model("e_k2", "2D", _NESTED[:2], isotropic_kernel, "Sect. 3.4.6"),
    _paper_model("e_k3", "3D", _NESTED[:3], isotropic_kernel, "Sect. 3.4.6"),
    _paper_model("e_k4", "4D", _NESTED[:4], isotropic_kernel, "Sect. 3.4.7"),
    _paper_model("e_k6_plus", "6D", _SIX, isotropic_kernel, "Sect. 3.4.8, Eq. 20"),
    _paper_model("e_k6_star", "6D ARD", _SIX, ard_kernel, "Sect. 3.4.8"),
    _paper_model("e_k6", "6D product", _SIX, product_kernel, "Sect. 3.4.8, Eq. 21"),
    _paper_model("e_k6_lin", "6D linear", _SIX, linear_kernel, "Sect. 3.4.9"),
)

MODELS = (*QUALITY_MODELS, *EXPOSURE_TIME_MODELS)
"""Every model of the paper's Tables 2 and 3, in their order."""


def model_named(name: str) -> ModelSpecification:
    """Return the paper's model of this name; `InputError` lists them if there is none."""
    names = [specification.name for specification in MODELS]
    if name not in names:
        msg = f"no model '{name}'; expected one of {', '.join(names)}{did_you_mean(name, names)}"
        raise InputError(msg)
    return MODELS[names.index(name)]

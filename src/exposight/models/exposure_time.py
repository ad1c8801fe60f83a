"""The exposure-time models ᵉGP of Sect. 3.4: the exposure that yields a wanted brightness.

They learn only from observations of sufficient quality, p_norm ≥ 0.75 (Sect. 3.4.1). Their kernels
are the exponential ones of Eq. 18 in GPy's form σ²·exp(−r), which Table 8's values need; see
`exposight.gp.Exponential`.
"""

from collections.abc import Callable

from exposight.gp import Exponential, Kernel, Linear
from exposight.models.specification import ModelSpecification

P_NORM_MIN = 0.75
"""Least quality to learn an exposure time from (Sect. 3.4.1)."""

_BRIGHTNESS = ("i_avg",)
_POSE = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg")


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


def _model(
    name: str, title: str, inputs: tuple[str, ...], kernel: Callable[[int], Kernel], source: str
) -> ModelSpecification:
    return ModelSpecification(
        name=name,
        title=f"exposure time, {title}",
        target="exposure_ms",
        inputs=inputs,
        kernel=kernel(len(inputs)),
        p_norm_min=P_NORM_MIN,
        source=source,
    )


_SIX = _BRIGHTNESS + _POSE

EXPOSURE_TIME_MODELS = (
    _model("e_k1", "1D", _BRIGHTNESS, isotropic_kernel, "Sect. 3.4.5, Eq. 19"),
    _model("e_k2", "2D", ("i_avg", "z_mm"), isotropic_kernel, "Sect. 3.4.6"),
    _model("e_k3", "3D", ("i_avg", "z_mm", "x_mm"), isotropic_kernel, "Sect. 3.4.6"),
    _model("e_k4", "4D", ("i_avg", "z_mm", "x_mm", "y_mm"), isotropic_kernel, "Sect. 3.4.7"),
    _model("e_k6_plus", "6D", _SIX, isotropic_kernel, "Sect. 3.4.8, Eq. 20"),
    _model("e_k6_star", "6D ARD", _SIX, ard_kernel, "Sect. 3.4.8"),
    _model("e_k6", "6D product", _SIX, product_kernel, "Sect. 3.4.8, Eq. 21"),
    _model("e_k6_lin", "6D linear", _SIX, linear_kernel, "Sect. 3.4.9"),
)

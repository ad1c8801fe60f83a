"""The quality models ᵠGP of Sect. 3.3: p_norm from brightness and position.

All share one base kernel (Eq. 9): a rational quadratic with a length scale for each input, switched
off below i_avg = 10 and above 255 by the change-point kernels, where the prediction is exactly 0.
They learn from every measured observation.
"""

from exposight.gp import ChangePoint, Kernel, RationalQuadratic
from exposight.models.specification import ModelSpecification

I_AVG_MIN = 10.0
"""Below this mean grey value there are no points (Sect. 3.3.3 and Fig. 10)."""
I_AVG_MAX = 255.0
"""Full scale of the 8-bit range (Sect. 3.3.3)."""


def base_kernel(n_inputs: int) -> Kernel:
    """Return the form k_RQ · k_CP,min · k_CP,max (Eq. 9).

    Parameters
    ----------
    n_inputs : int
        How many inputs it reads; the first is i_avg.
    """
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


def _model(name: str, inputs: tuple[str, ...], source: str) -> ModelSpecification:
    return ModelSpecification(
        name=name,
        title=f"quality, {len(inputs)}D",
        target="p_norm",
        inputs=inputs,
        kernel=base_kernel(len(inputs)),
        p_norm_min=None,
        source=source,
    )


QUALITY_MODELS = (
    _model("q_k1", ("i_avg",), "Sect. 3.3.4, Eq. 11"),
    _model("q_k2", ("i_avg", "z_mm"), "Sect. 3.3.5, Eq. 14"),
    _model("q_k3", ("i_avg", "z_mm", "x_mm"), "Sect. 3.3.5"),
    _model("q_k4", ("i_avg", "z_mm", "x_mm", "y_mm"), "Sect. 3.3.6, Eq. 15"),
    _model("q_k6", ("i_avg", "z_mm", "x_mm", "y_mm", "w_deg", "p_deg"), "Sect. 3.3.7"),
)

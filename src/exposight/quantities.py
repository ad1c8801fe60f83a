"""One catalogue of the quantities that the program measures and predicts, by column name.

Symbols, units, decimals and full scales of tables, pages, pictures and the command line come from
here; nothing else lists them.
"""

import html
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Literal


@dataclass(frozen=True)
class Quantity:
    """How a measured or predicted quantity is written.

    Parameters
    ----------
    symbol : str
        The paper's letter, and after an underscore what stands below it: ``p_norm``.
    name : str
        In words, in lower case.
    unit : str
        On an axis, ``"1"`` for pure numbers.
    digits : int
        Decimals in tables.
    low, high : float or None
        Full scale in that unit; None where there is no limit.
    suffix : str
        Unit after a single value; empty where it goes without.
    error_unit : str
        Unit in which errors are given.
    error_factor : float
        From the quantity's unit to that of its errors: errors of p_norm are percent of full scale.
    better : {'higher', 'lower'} or None
        Which is better, where that can be said; an error with a sign is better the smaller its
        size.
    signed : bool
        True of an error that has a sign.
    """

    symbol: str
    name: str
    _: KW_ONLY
    unit: str
    digits: int
    low: float | None = None
    high: float | None = None
    suffix: str = ""
    error_unit: str = ""
    error_factor: float = 1.0
    better: Literal["higher", "lower"] | None = None
    signed: bool = False

    @property
    def html(self) -> str:
        """Symbol in HTML that plotly's texts take, too: letters italic, words below them not."""
        letter, _, index = self.symbol.partition("_")
        below = f"<sub>{html.escape(index)}</sub>" if index else ""
        return f"<i>{html.escape(letter)}</i>{below}"

    @property
    def math(self) -> str:
        """Symbol for pictures drawn by matplotlib, written by ISO 80000-1."""
        letter, _, index = self.symbol.partition("_")
        return f"${letter}_\\mathrm{{{index}}}$" if index else f"${letter}$"

    @property
    def axis_html(self) -> str:
        """Title of an axis: the symbol, in brackets its unit; HTML."""
        return f"{self.html} ({self.unit})"

    @property
    def axis_math(self) -> str:
        """Title of an axis of a picture drawn by matplotlib."""
        return f"{self.math} ({self.unit})"

    @property
    def squared_unit(self) -> str:
        """Unit of a variance; empty for pure numbers."""
        return f"{self.suffix}²" if self.suffix else ""


_share = partial(
    Quantity, unit="1", digits=2, low=0.0, high=1.0, error_unit="%", error_factor=100.0
)
_grey = partial(
    Quantity, unit="grey level 0–255", digits=1, low=0.0, high=255.0, suffix="grey levels",
    error_unit="grey levels",
)  # fmt: skip
_length = partial(Quantity, unit="mm", digits=1, suffix="mm", error_unit="mm")
_small = partial(
    Quantity, unit="mm", digits=3, low=0.0, suffix="mm", error_unit="mm", better="lower"
)
_angle = partial(Quantity, unit="°", digits=1, low=-180.0, high=180.0, suffix="°", error_unit="°")
_count = partial(Quantity, unit="1", digits=0, low=0.0)

STACK_PERCENTS = (5, 25, 50, 75, 95)
"""Percentiles that are kept of what a frame stack tells of a ring's pixels."""

QUANTITIES = {
    "p_norm": _share("p_norm", "point-cloud quality", better="higher"),
    "exposure_ms": Quantity(
        "t_exp", "exposure time", unit="ms", digits=2, low=0.0, suffix="ms", error_unit="ms"
    ),
    "i_avg": _grey("i_avg", "mean brightness of the ring"),
    "x_mm": _length("x_tcp", "position along x"),
    "y_mm": _length("y_tcp", "position along y"),
    "z_mm": _length("z_tcp", "position along z"),
    "w_deg": _angle("w_tcp", "rotation about x"),
    "p_deg": _angle("p_tcp", "rotation about y"),
    "r_deg": _angle("r_tcp", "rotation about z"),
    "radius_mm": _length("r_f", "radius of the feature", low=0.0),
    "n_points": _count("n_pts", "points in the hollow cylinder"),
    "n_pixels": _count("n_px", "pixels of the ring"),
    "i_std": _grey("i_std", "standard deviation of the ring's brightness"),
    "i_median": _grey("i_med", "median brightness of the ring"),
    "i_p05": _grey("i_05", "5th percentile of the ring's brightness"),
    "i_p95": _grey("i_95", "95th percentile of the ring's brightness"),
    "clipped_share": _share("s_clip", "share of the ring's pixels at full scale"),
    "incidence_deg": _angle("θ", "angle between ray and surface normal", low=-90.0, high=90.0),
    "i_mean": _grey("i_mean", "mean brightness of the ring without the pattern"),
    **{
        f"{column}_p{percent:02d}": _grey(
            f"{column},{percent:02d}", f"{percent}th percentile of the ring's {words}"
        )
        for column, words in (
            ("i_mean", "brightness without the pattern"),
            ("i_max", "brightest frame"),
            ("i_mod", "weakest amplitude of the patterns"),
        )
        for percent in STACK_PERCENTS
    },
    "stack_clipped_share": _share("s_full", "share of the ring's pixels that some frame clips"),
    "low_modulation_share": _share("s_low", "share of the ring's pixels of too low amplitude"),
    "sigma_z_mm": _small("σ_z", "median standard deviation of the ring's points"),
    "plane_std_mm": _small("s_plane", "standard deviation about the ring's plane"),
    "form_error_mm": _small("F_95", "form error of the ring, middle 95 %"),
    "largest_gap_deg": Quantity("γ_gap", "largest gap round the ring", unit="°", digits=1,
                                low=0.0, high=360.0, suffix="°", better="lower",
        error_unit="°"),
    "diameter_mm": _small("d_f", "diameter of the hole's rim", better=None),
    "diameter_error_mm": _small("Δd_f", "diameter error of the hole's rim", low=None, signed=True),
    "centre_error_mm": _small("e_c", "distance of the rim's centre from its nominal place"),
    "part_w_deg": _angle("w_part", "rotation of the part about x"),
    "part_p_deg": _angle("p_part", "rotation of the part about y"),
    "part_r_deg": _angle("r_part", "rotation of the part about z"),
}  # fmt: skip
"""Every numeric column of an observation table."""

_SUFFIXES = {"ms": "ms", "mm": "mm", "deg": "°"}


def quantity(column: str) -> Quantity:
    """Return a column's quantity; one that is not in the catalogue is written as it is called.

    Parameters
    ----------
    column : str
        Its name; the unit of an unknown one follows from its end: ``_ms``, ``_mm`` or ``_deg``.
    """
    if column in QUANTITIES:
        return QUANTITIES[column]
    words, _, end = column.rpartition("_")
    unit = _SUFFIXES.get(end, "") if words else ""
    name = (words if unit else column).replace("_", " ")
    return Quantity(name, name, unit=unit or "1", digits=2, suffix=unit, error_unit=unit)

"""Words and names that the study's page repeats."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from exposight.report.markup import escape

if TYPE_CHECKING:
    from exposight.paper.result import SensorKind, StudyResult

__all__ = ["SENSOR_TITLES", "column_name", "measured_in", "rung_code", "rung_name"]

SENSOR_TITLES: dict[SensorKind, str] = {
    "structured-light": "structured-light sensor",
    "stereo": "active stereo sensor",
}
_RUNG = re.compile(r"([qe])_k(\d)(?:_(plusplus|plus|star|lin))?(_s2)?")
_VARIANTS = {None: "", "plus": "+", "plusplus": "++", "star": "*", "lin": "lin"}
_COLUMNS = {
    "p_norm": "<i>p</i><sub>norm</sub>",
    "exposure_ms": "<i>t</i><sub>exp</sub>",
    "i_avg": "<i>i</i><sub>avg</sub>",
    "x_mm": "<i>x</i><sub>tcp</sub>",
    "y_mm": "<i>y</i><sub>tcp</sub>",
    "z_mm": "<i>z</i><sub>tcp</sub>",
    "w_deg": "<i>w</i><sub>tcp</sub>",
    "p_deg": "<i>p</i><sub>tcp</sub>",
    "r_deg": "<i>r</i><sub>tcp</sub>",
    "radius_mm": "<i>r</i><sub>f</sub>",
}


def rung_name(name: str) -> str:
    """Return a rung's name as the paper prints it, in HTML that plotly's texts take, too."""
    found = _RUNG.fullmatch(name)
    if found is None:
        return escape(name)
    target, dimensions, variant, stereo = found.groups()
    above = _VARIANTS[variant] + ("s₂" if stereo else "")
    raised = f"<sup>{above}</sup>" if above else ""
    return f"<sup>{target}</sup><i>k</i><sub>{dimensions}</sub>{raised}"


def rung_code(name: str) -> str:
    """Return a rung's name as the paper prints it, and as files and commands write it."""
    return f"{rung_name(name)} <code>{escape(name)}</code>"


def column_name(name: str) -> str:
    """Return a column's name as the paper prints it, as HTML."""
    return _COLUMNS.get(name, escape(name))


def measured_in(result: StudyResult) -> str:
    """Return where the observations come from, to be said with every figure."""
    if result.settings.campaigns is None:
        return "Measured in the simulated cell."
    return "Measured in the recorded campaigns."

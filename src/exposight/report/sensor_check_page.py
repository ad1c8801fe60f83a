"""The page on which a simulated sensor's measured figures stand beside its table's."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from exposight.cell import preset_name
from exposight.files import write_durably
from exposight.quantities import QUANTITIES
from exposight.report.figures import Still, draw_still, label_panel, plain_axes
from exposight.report.palette import ACCENT, CLIPPED, MUTED, OUTSIDE
from exposight.report.rendering import Number, render_page, rounded, significant
from exposight.tables import number
from exposight.twin.check import GOOD_P_NORM, CheckedFigure, SensorCheck

_SIZE_IN = (4.7, 3.3)


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A compared figure as the page shows it."""

    figure: CheckedFigure
    measured: Number
    expected: Number
    deviation: str
    tolerance: str


def write_sensor_check(check: SensorCheck, path: str | Path) -> None:
    """Write a check's page: one file that opens without a network.

    Parameters
    ----------
    check : SensorCheck
        What was measured.
    path : path
        The file; what is there is replaced.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    write_durably(Path(path), sensor_check_page(check).encode())


def sensor_check_page(check: SensorCheck) -> str:
    """Return the page; the same check, the same page."""
    rows = {figure.name: _row(figure) for figure in check.figures}
    deviating = [figure.name for figure in check.deviating]
    rises, falls = check.ring.crossings(GOOD_P_NORM)
    camera, lens = check.electronics, check.sensor.camera
    times = f"{check.sensor.exposure.min_ms:g} to {check.sensor.exposure.max_ms:g} ms"
    return render_page(
        "sensor_check.html",
        title=f"{check.sensor.name}: check of the simulated sensor",
        lead="The simulated cell measures its own sensor as EMVA 1288 measures a camera, and on "
        "plates whose place is known. Beside each figure stands what the sensor’s table says.",
        check=check,
        rows=rows,
        camera_rows=[row for name, row in rows.items() if not name.startswith(("depth", "matt"))],
        plate_agrees=[
            not any(name.endswith(f"_at_{plate.distance_mm:.0f}_mm") for name in deviating)
            for plate in check.plates
        ],
        good_range=_good_range(rises, falls),
        rises=rises,
        falls=falls,
        plateau=check.ring.plateau(GOOD_P_NORM),
        good=GOOD_P_NORM,
        times=times,
        transfer=_transfer_still(check),
        linearity=_linearity_still(check),
        quality=_quality_still(check),
        depth=_depth_still(check),
        facts=(
            ("sensor", preset_name(check.sensor) or check.sensor.name),
            (
                "camera",
                f"{lens.width} × {lens.height} px, {camera.bit_depth} bits, focal length "
                f"{lens.fx:.4g} px",
            ),
            ("exposure times", times),
            (
                "working distance",
                f"{check.sensor.working_distance_mm[0]:g} to "
                f"{check.sensor.working_distance_mm[1]:g} mm",
            ),
        ),
    )


def _good_range(rises: float, falls: float) -> str:
    if math.isnan(falls):
        return "–" if math.isnan(rises) else f"from {number(rises, 3)}"
    return (
        f"to {number(falls, 3)}"
        if math.isnan(rises)
        else f"{number(rises, 3)} to {number(falls, 3)}"
    )


def _row(figure: CheckedFigure) -> _Row:
    expected = figure.expected
    if math.isnan(figure.deviation):
        deviation, tolerance = "–", "–"
    elif expected:
        percent = 100 / abs(expected)
        deviation = f"{rounded(percent * figure.deviation, 2, signed=True)} %"
        tolerance = f"± {number(percent * figure.tolerance, 2)} %"
    else:
        deviation = f"{'' if figure.deviation < 0 else '+'}{number(figure.deviation, 2)}"
        tolerance = f"± {number(figure.tolerance, 2)}"
    return _Row(
        figure=figure,
        measured=significant(figure.measured, 4),
        expected=significant(expected, 4),
        deviation=deviation,
        tolerance=tolerance,
    )


def _transfer_still(check: SensorCheck) -> Still:
    """Draw the variance of flat fields over their mean, and the line whose slope is the gain."""
    flats = check.flat_fields

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot(flats.mean, flats.variance, "o", color=ACCENT, markersize=4.5)
        if not math.isnan(flats.gain_dn_per_e):
            ends = np.array([0.0, flats.mean.max()])
            noise = flats.dark_noise_dn**2
            axes.plot(ends, noise + flats.gain_dn_per_e * ends, color=OUTSIDE, zorder=0)
            saturated = flats.saturation_e * flats.gain_dn_per_e
            axes.axvline(saturated, color=CLIPPED, linewidth=1, linestyle=":")
            _note(axes, saturated, "saturation", left=True)
        axes.set_xlim(0, None)
        axes.set_ylim(0, None)
        plain_axes(axes, "mean above black level (DN)", "temporal variance (DN²)")
        label_panel(axes, "Photon transfer")

    return draw_still("transfer", "Temporal variance over mean of flat fields", _SIZE_IN, draw)


def _linearity_still(check: SensorCheck) -> Still:
    """Draw the deviation of flat fields' mean from a line over the light."""
    flats = check.flat_fields

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0, color=OUTSIDE)
        axes.plot(100 * flats.share, flats.deviation_percent, "o-", color=ACCENT, markersize=4.5)
        reach = max(0.05, 1.25 * float(np.nanmax(np.abs(flats.deviation_percent))))
        axes.set_ylim(-reach, reach)
        axes.set_xlim(0, 100)
        plain_axes(axes, "light (% of full well)", "deviation from a line (%)")
        label_panel(axes, "Linearity")

    return draw_still("linearity", "Deviation of flat fields from a line", _SIZE_IN, draw)


def _quality_still(check: SensorCheck) -> Still:
    """Draw p_norm over brightness, and where it rises and falls."""
    ring = check.ring

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(GOOD_P_NORM, color=MUTED, linewidth=0.9, linestyle="--")
        axes.plot(ring.i_avg, ring.p_norm, "o-", color=ACCENT, markersize=4.5)
        for place, left in zip(ring.crossings(GOOD_P_NORM), (False, True), strict=True):
            if not math.isnan(place):
                axes.axvline(place, color=OUTSIDE, linewidth=1, linestyle=":")
                _note(axes, place, f"{place:.0f}", left=left, height=0.5)
        axes.set_xlim(0, 255)
        axes.set_ylim(-0.04, 1.12)
        plain_axes(axes, QUANTITIES["i_avg"].axis_math, QUANTITIES["p_norm"].axis_math)
        label_panel(axes, "Quality over brightness, primer at the TCP")

    return draw_still("quality", "p_norm over brightness", _SIZE_IN, draw)


def _depth_still(check: SensorCheck) -> Still:
    """Draw errors of depth over distance."""
    distances = [plate.distance_mm for plate in check.plates]
    lines = (
        ("median |error|", "median_error_mm", "s-", MUTED),
        ("noise on the plate", "noise_mm", "D-", OUTSIDE),
        ("between captures", "repeat_noise_mm", "o-", ACCENT),
        ("predicted", "predicted_noise_mm", "x--", CLIPPED),
    )

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for label, name, style, colour in lines:
            values = np.array([getattr(plate, name) for plate in check.plates])
            if np.isfinite(values).any():
                axes.plot(distances, values, style, color=colour, markersize=5, label=label)
        axes.set_ylim(0, None)
        if axes.lines:
            axes.legend(loc="upper left")
        plain_axes(axes, "distance (mm)", "depth (mm)")
        label_panel(axes, "Error and noise of depth, tilted plate in primer")

    return draw_still("depth", "Errors of depth over distance", _SIZE_IN, draw)


def _note(axes: Axes, x: float, text: str, *, left: bool, height: float = 0.06) -> None:
    """Write beside a vertical line."""
    axes.annotate(
        text,
        (x, height),
        xycoords=axes.get_xaxis_transform(),
        xytext=(-4 if left else 4, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        color=MUTED,
        fontsize=8,
    )

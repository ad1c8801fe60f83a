"""The simulated cell measures itself: whether a sensor does what its table says.

The camera by EMVA 1288's methods, brightness on matt white, depth against a plane, p_norm over
brightness; beside each figure stands what the sensor's document and settings make one expect.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from exposight.cell import GREY_MAX, ActiveSensor, full_scale
from exposight.twin import sensors
from exposight.twin.cell_settings import SimulatedCellSettings
from exposight.twin.matt_white import MattWhiteBrightness, measure_matt_white
from exposight.twin.plates import PlateBench, PlateDepth, RingBrightness
from exposight.twin.sensors.flat_fields import dynamic_range_db, quantised_noise_dn
from exposight.twin.simulated_cell import sensor_model
from exposight.workers import Progress, ignore_progress

GOOD_P_NORM = 0.75
"""Where p_norm is judged to rise and to fall: the paper's least quality (Sect. 3.3.2)."""
_PLATES_STAGE = "plates before the sensor"
_POINTS_SHARE, _COVERED_SHARE = 0.9, 0.95
"""Less than these is worth a remark."""


@dataclass(frozen=True, kw_only=True)
class CheckedFigure:
    """A measured figure beside the expected one.

    Parameters
    ----------
    name : str
        Of the figure, for machines.
    label, unit : str
        For people.
    measured, expected, tolerance : float
        In that unit; NaN where it cannot be measured or nothing is expected.
    """

    name: str
    label: str
    unit: str
    measured: float
    expected: float
    tolerance: float

    @property
    def deviation(self) -> float:
        """Measured less expected."""
        return self.measured - self.expected

    @property
    def agrees(self) -> bool | None:
        """Whether the deviation is within the tolerance; None where there is none."""
        return None if math.isnan(self.deviation) else abs(self.deviation) <= self.tolerance


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorCheck:
    """What a simulated sensor is, measured.

    Parameters
    ----------
    sensor : ActiveSensor
        The sensor.
    electronics : CameraElectronics
        What its table says of its camera.
    flat_fields : FlatFields
        The camera.
    matt_white : MattWhiteBrightness
        The sensitivity.
    plates : tuple of PlateDepth
        Depth: near, at the TCP, far.
    ring : RingBrightness
        p_norm over brightness.
    figures : tuple of CheckedFigure
        Everything that can be compared.
    remarks : tuple of str
        Sentences about what the sensor cannot do, and what could not be measured.
    """

    sensor: ActiveSensor
    electronics: sensors.CameraElectronics
    flat_fields: sensors.FlatFields
    matt_white: MattWhiteBrightness
    plates: tuple[PlateDepth, ...]
    ring: RingBrightness
    figures: tuple[CheckedFigure, ...]
    remarks: tuple[str, ...]

    @property
    def deviating(self) -> tuple[CheckedFigure, ...]:
        """The figures outside their tolerances."""
        return tuple(figure for figure in self.figures if figure.agrees is False)

    @property
    def measures_primer(self) -> bool:
        """Whether the plate at the TCP has points on half of what is covered, or more."""
        plate = self.plates[1]
        return plate.points_share >= 0.5 * plate.covered_share > 0.0

    @property
    def verdict(self) -> str:
        """Whether the sensor does what its table says, in words."""
        judged = sum(figure.agrees is not None for figure in self.figures)
        blind = "" if self.measures_primer else " It measures no primer at the TCP."
        if not self.deviating:
            return (
                f"The simulated sensor does what its table says: all {judged} figures agree.{blind}"
            )
        told = "; ".join(
            f"{figure.label} {figure.measured:.4g} in place of {figure.expected:.4g} {figure.unit}"
            for figure in self.deviating
        )
        return (
            f"The simulated sensor deviates from its table in {len(self.deviating)} of {judged} "
            f"figures: {told}.{blind}"
        )


def check_sensor(
    sensor: ActiveSensor,
    cell: SimulatedCellSettings | None = None,
    *,
    progress: Progress = ignore_progress,
) -> SensorCheck:
    """Measure a simulated sensor.

    Parameters
    ----------
    sensor : ActiveSensor
        With a projector; its table ``simulated`` is read.
    cell : SimulatedCellSettings, optional
        Lighting, and what is otherwise than in the sensor's table; scene and alignment do not
        count.
    progress : Progress
        Receives what is done.

    Raises
    ------
    FormatError, SensorError, ImageError
        If the sensor cannot be simulated, its dark current fills its pixels, or its TCP is not in
        its camera's image.
    """
    cell = cell or SimulatedCellSettings()
    settings = sensors.sensor_settings(sensor, cell.sensor)
    model = sensor_model(sensor, cell)
    bench = PlateBench(model)
    near_mm, tcp_mm, far_mm = bench.distances_mm()
    progress(_PLATES_STAGE, 0, 5)
    white = measure_matt_white(model, settings)
    progress(_PLATES_STAGE, 1, 5)
    near = bench.depth(bench.look(near_mm), 0)
    progress(_PLATES_STAGE, 2, 5)
    view = bench.look(tcp_mm)
    middle = bench.depth(view, 1)
    progress(_PLATES_STAGE, 3, 5)
    ring = bench.ring(view, GOOD_P_NORM)
    progress(_PLATES_STAGE, 4, 5)
    plates = (near, middle, bench.depth(bench.look(far_mm), 2))
    progress(_PLATES_STAGE, 5, 5)
    flats = sensors.take_flat_fields(model.electronics, sensor.exposure, progress)
    return SensorCheck(
        sensor=sensor,
        electronics=model.electronics,
        flat_fields=flats,
        matt_white=white,
        plates=plates,
        ring=ring,
        figures=(
            *_camera_figures(flats, model.electronics, sensor.exposure.min_ms),
            *_light_figures(white),
            *(figure for plate in plates for figure in _depth_figures(plate)),
        ),
        remarks=tuple(_remarks(model, flats, white, plates, ring)),
    )


def _camera_figures(
    flats: sensors.FlatFields, table: sensors.CameraElectronics, shortest_ms: float
) -> Iterator[CheckedFigure]:
    """Compare the camera with its table; tolerances are what 1024² pixels and whole DN leave."""
    per_e = table.gain
    full_e = table.full_well_e
    level = GREY_MAX / full_scale(table.bit_depth)
    # Dark images are taken at the shortest exposure time, in which some dark current flows.
    dark_signal_e = table.dark_current_e_per_s * shortest_ms / 1000
    dark_e = math.sqrt(table.read_noise_e**2 + dark_signal_e)
    black = table.black_level + per_e * dark_signal_e * level
    # The photon transfer's intercept is as good as its darkest point and quantisation are.
    blur_e2 = 0.0 if flats.is_dark_resolved else (0.01 + 0.005 * flats.variance[0]) / per_e**2
    dark_tolerance = 0.03 * dark_e + math.sqrt(dark_e**2 + blur_e2) - dark_e
    # Pixels brighter than the mean clip before it: the variance is largest a little lower.
    spread = 3.0 * math.sqrt(1.0 / full_e + table.prnu**2) + 0.015
    total_dn = quantised_noise_dn(table, dark_e)
    total_e = total_dn / per_e
    rows = (
        ("black_level", "black level", "grey levels", flats.black_level, black,
         0.5 * level + 0.05),
        ("dark_noise_e", "temporal dark noise", "e⁻", flats.dark_noise_e, dark_e, dark_tolerance),
        ("dark_noise_dn", "temporal dark noise, quantised", "DN", flats.dark_noise_dn,
         total_dn, per_e * dark_tolerance + 0.01),
        ("dark_current_e_per_s", "dark current", "e⁻/s", flats.dark_current_e_per_s,
         table.dark_current_e_per_s, 0.1 * table.dark_current_e_per_s),
        ("system_gain_dn_per_e", "system gain K", "DN/e⁻", flats.gain_dn_per_e, per_e,
         0.01 * per_e),
        ("linearity_error_percent", "linearity error", "%", flats.linearity_error_percent, 0.0,
         0.5),
        ("full_well_e", "full well", "e⁻", flats.full_well_e, full_e, 0.01 * full_e),
        ("saturation_capacity_e", "saturation capacity", "e⁻", flats.saturation_e, full_e,
         spread * full_e),
        ("snr_max", "largest signal-to-noise ratio", "1", flats.snr_max, math.sqrt(full_e),
         spread * math.sqrt(full_e)),
        ("dynamic_range_db", "dynamic range", "dB", flats.dynamic_range_db,
         dynamic_range_db(full_e, total_e), 1.0),
        ("prnu_percent", "PRNU", "%", flats.prnu_percent, 100 * table.prnu,
         2 * table.prnu + 0.02),
        ("dsnu_e", "DSNU", "e⁻", flats.dsnu_e, 0.0, 0.1 * total_e),
    )  # fmt: skip
    yield from (
        CheckedFigure(
            name=name,
            label=label,
            unit=unit,
            measured=measured,
            expected=expected,
            tolerance=tolerance,
        )
        for name, label, unit, measured, expected, tolerance in rows
    )


def _light_figures(white: MattWhiteBrightness) -> Iterator[CheckedFigure]:
    yield CheckedFigure(
        name="matt_white_grey_levels_per_ms",
        label="brightness of matt white at the TCP",
        unit="grey levels/ms",
        measured=white.grey_levels_per_ms,
        expected=white.expected_per_ms,
        tolerance=0.03 * white.expected_per_ms,
    )


def _depth_figures(plate: PlateDepth) -> Iterator[CheckedFigure]:
    at = f"at {plate.distance_mm:.0f} mm"
    yield CheckedFigure(
        name=f"depth_bias_mm_at_{plate.distance_mm:.0f}_mm",
        label=f"depth bias {at}",
        unit="mm",
        measured=plate.bias_mm,
        expected=0.0,
        tolerance=plate.noise_mm,
    )
    yield CheckedFigure(
        name=f"depth_noise_mm_at_{plate.distance_mm:.0f}_mm",
        label=f"depth noise between captures {at}",
        unit="mm",
        measured=plate.repeat_noise_mm,
        expected=plate.predicted_noise_mm,
        tolerance=0.1 * plate.predicted_noise_mm,
    )


def _remarks(
    model: sensors.StripeSensor | sensors.DotSensor,
    flats: sensors.FlatFields,
    white: MattWhiteBrightness,
    plates: tuple[PlateDepth, ...],
    ring: RingBrightness,
) -> Iterator[str]:
    """Say what the sensor cannot do, and what could not be measured."""
    sensor, bits = model.sensor, model.electronics.bit_depth
    shortest, longest = sensor.exposure.min_ms, sensor.exposure.max_ms
    times = f"exposure times of {shortest:g} to {longest:g} ms"
    if math.isnan(flats.gain_dn_per_e):
        yield (
            f"{bits} bits are too coarse for a full well of {model.electronics.full_well_e:.0f} e⁻:"
            " shot noise is lost in quantisation, so gain and noise cannot be measured."
        )
    elif flats.is_dark_clipped:
        yield (
            "Dark images clip at 0: raise the black level to see the dark noise. It is the photon "
            "transfer’s intercept here."
        )
    elif not flats.is_dark_resolved:
        yield (
            f"{bits} bits do not resolve the dark noise (a variance below 0.24 DN²). It is the "
            "photon transfer’s intercept here."
        )
    if math.isnan(white.clips_at_ms):
        brightest = white.grey_levels_per_ms * longest
        yield (
            f"With {times}, matt white at the TCP does not clip: it has at most {brightest:.0f} "
            "grey levels on average."
        )
    elif white.clips_at_ms == shortest:
        yield f"With {times}, matt white at the TCP is always clipped."
    dots = isinstance(model, sensors.DotSensor)
    if isinstance(model, sensors.DotSensor):
        yield "The two cameras are alike but for their fixed patterns: the first was measured."
        near_mm, far_mm = model.matched_mm
        if (near_mm, far_mm) != sensor.working_distance_mm:
            yield f"Depths are matched from {near_mm:g} to {far_mm:g} mm."
    if min(plate.covered_share for plate in plates) < _COVERED_SHARE:
        eyes = "Projector and cameras together cover" if dots else "The projector lights"
        shares = ", ".join(f"{100 * plate.covered_share:.0f} %" for plate in plates)
        places = ", ".join(f"{plate.distance_mm:.0f}" for plate in plates)
        yield f"{eyes} {shares} of the image at {places} mm."
    for plate in plates:
        if plate.points_share < _POINTS_SHARE * plate.covered_share:
            why = "."
            limit_mm = getattr(model, "max_depth_noise_mm", None)
            if limit_mm is not None and plate.predicted_noise_mm > limit_mm:
                why = (
                    f": a depth noise of {plate.predicted_noise_mm:.2g} mm is predicted, "
                    f"max_depth_noise_mm is {limit_mm:g}."
                )
            elif plate.exposure_ms in (shortest, longest):
                which = "longest" if plate.exposure_ms == longest else "shortest"
                why = f": the {which} exposure time gives {plate.grey_levels:.0f} grey levels."
            yield (
                f"At {plate.distance_mm:.0f} mm at most {100 * plate.points_share:.0f} % of the "
                f"pixels have a point{why}"
            )
    if not ring.p_norm.size:
        yield "The ring about the TCP is not in the image: p_norm was not measured."
    elif not (ring.p_norm >= GOOD_P_NORM).any():
        yield f"p_norm never reaches {GOOD_P_NORM:g} on primer at the TCP."
    elif math.isnan(ring.crossings(GOOD_P_NORM)[1]):
        yield (
            f"p_norm does not fall on primer at the TCP: the longest exposure time gives "
            f"{ring.i_avg[-1]:.0f} grey levels."
        )

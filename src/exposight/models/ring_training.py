"""Training of the default models: radiance, the sensor's limits, and other qualities of a ring."""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import count

import numpy as np
import polars as pl

from exposight.cell import PRESETS, ActiveSensor
from exposight.errors import InputError, ObservationError
from exposight.models.abstaining import curved
from exposight.models.evaluation import check_exposures, check_rows
from exposight.models.log_radiance import LogRadiance
from exposight.models.origin import Origin
from exposight.models.predictor import Provenance
from exposight.models.radiance_model import EXPOSURE, QUALITY, RadianceModel
from exposight.models.radiance_search import MeanKind
from exposight.models.response_curve import (
    LEAST_MEASURED,
    Better,
    ResponseCurve,
    measured_between,
    rows_of_quality,
)
from exposight.models.ring_data import ring_data
from exposight.models.ring_light import POSE_COLUMNS, Rings, check_places
from exposight.models.window_fit import fit_window
from exposight.models.window_model import WindowModel
from exposight.observing import ObservationTable, tcp_text
from exposight.quantities import quantity
from exposight.tables import counted
from exposight.workers import Progress, ignore_progress

logger = logging.getLogger(__name__)

EVALUATIONS = "evaluations of the posterior"


def keeps_limits(previous: RadianceModel, sensor: ActiveSensor | None, origin: Origin) -> bool:
    """Return whether a model's limits hold for observations: they are of the same sensor."""
    if previous.sensor is None or sensor is None:
        named = previous.origin.sensor
        return previous.sensor is sensor and bool(named) and named == origin.sensor
    return previous.sensor == sensor


MOST_RINGS = 3000
"""So many rings are learnt from at most: time grows with their cube, memory with their square,
while the error of 3000 rings (each from all its captures) is that of what no ring tells."""

_LEAST_RINGS = 3
"""Fewer rings leave nothing to learn a band from."""


def train_window(
    table: ObservationTable,
    *,
    sensor: ActiveSensor | None = None,
    mean: MeanKind | None = None,
    start_from: WindowModel | None = None,
    source: str = "a table in memory",
    source_sha256: str | None = None,
    seed: int | None = None,
    progress: Progress = ignore_progress,
) -> WindowModel:
    """Train the radiance model and the window model on observations.

    Parameters
    ----------
    table : ObservationTable
        Rows that were not measured are left out.
    sensor : ActiveSensor, optional
        The sensor of the observations. Left out, it is that of `start_from`, or the preset that the
        table names.
    mean : {'projector', 'camera', 'none'}, optional
        What the physical mean knows; as much as the sensor allows by default.
    start_from : WindowModel, optional
        A model of the same sensor on another finish: the sensor's limits are kept and the surface
        is learnt anew. Or of the same finish on another sensor: the surface's lobe is kept, and the
        limits are learnt anew. Its hyperparameters are where the search starts.
    source, source_sha256, seed
        Of the table; kept in the model's provenance.
    progress : Progress
        Receives the evaluations of the posterior that are done, whose number nobody knows before.

    Raises
    ------
    ObservationError
        If rows are of several finishes or sensors, nothing was measured, or too little of it.
    SensorError
        If the sensor cannot have taken a recorded exposure time.
    """
    measured = table.measured()
    check_rows(QUALITY, "train", measured, table)
    origin = Origin.of(measured)
    if sensor is None and start_from is not None:
        sensor = start_from.sensor
    if sensor is None:
        sensor = next((each for each in PRESETS.values() if each.name == origin.sensor), None)
    if sensor is not None and origin.sensor and origin.sensor != sensor.name:
        msg = f"the observations are of sensor {origin.sensor!r}, the one given is {sensor.name!r}"
        raise ObservationError(msg)
    check_exposures(measured, sensor)
    if mean is None:
        mean = "none" if sensor is None else "projector" if sensor.projector else "camera"
    if (sensor is None and mean != "none") or (
        sensor is not None and sensor.projector is None and mean == "projector"
    ):
        lacking = "a sensor" if sensor is None else f"a projector's pose of {sensor.name!r}"
        msg = f"mean {mean!r} needs {lacking}, which is not known; give it, or another mean"
        raise InputError(msg)
    if sensor is not None and origin.tcp and origin.tcp != tcp_text(sensor):
        msg = (
            f"the observations' poses are in a TCP frame at {origin.tcp!r} (mm and degrees, in "
            f"the camera's frame), that of the sensor given is at {tcp_text(sensor)!r}; give the "
            "sensor with which they were observed"
        )
        raise ObservationError(msg)
    previous = start_from.radiance if start_from is not None else None
    same_sensor = previous is not None and keeps_limits(previous, sensor, origin)
    if previous is not None and not same_sensor and previous.origin.finish != origin.finish:
        msg = (
            f"{start_from.name if start_from else ''} is of another sensor, or of one that is not "
            "known, and of another finish: there is nothing to keep; train from scratch"
        )
        raise InputError(msg)
    kept = previous if same_sensor else None
    flat = ~measured.frame["feature"].is_in(list(curved(measured.frame)))
    measured = measured.where(flat)
    if len(measured) == 0:
        msg = "all measured features are spheres: train on features about which the part is flat"
        raise ObservationError(msg)
    data = ring_data(measured, black_level=kept.black_level if kept else None)
    if len(data) < _LEAST_RINGS:
        msg = (
            f"{counted(len(data), 'ring')} (of a feature in a view) is too little to learn from; "
            f"at least {_LEAST_RINGS} are needed, and ten from several views for useful bands"
        )
        raise ObservationError(msg)
    check_places(data.rings, data.incidence_deg, sensor)
    if len(data) > MOST_RINGS:
        logger.info("learning from %d of %d rings", MOST_RINGS, len(data))
        data = data.thinned(MOST_RINGS)
        measured = measured.where(_is_of(data.rings, measured.frame))
    evaluations = count(1)
    learnt = LogRadiance.fit(
        data,
        sensor,
        kind=mean,
        start_from=previous.learnt if previous else None,
        same_surface=previous is not None
        and not same_sensor
        and previous.origin.finish == origin.finish,
        evaluated=lambda: progress(EVALUATIONS, next(evaluations), 0),
    )
    provenance = Provenance.of(measured, source=source, sha256=source_sha256, seed=seed)
    radiance = RadianceModel(
        name=EXPOSURE,
        title="exposure time, radiance",
        target="exposure_ms",
        inputs=(data.source, *POSE_COLUMNS),
        provenance=provenance,
        sensor=sensor,
        learnt=learnt,
        black_level=data.black_level,
        black_level_known=data.black_level_known,
        origin=origin,
    )
    known = start_from.window if start_from and same_sensor else None
    if isinstance(known, ResponseCurve):
        msg = f"{QUALITY} starts from a model of p_norm, which knows the sensor's limits"
        raise InputError(msg)
    window = fit_window(learnt, data, measured.frame, start_from=known)
    return WindowModel(
        name=QUALITY,
        title="quality, window",
        target="p_norm",
        inputs=(*POSE_COLUMNS, "exposure_ms"),
        provenance=provenance,
        sensor=sensor,
        radiance=radiance,
        window=window,
        n_rows=len(measured),
    )


def _is_of(rings: Rings, frame: pl.DataFrame) -> pl.Series:
    """Return which rows of a frame are of some rings, by feature and view."""
    kept = pl.DataFrame({"feature": rings.features, "view": rings.views, "_kept": True})
    joined = frame.select("feature", "view").join(
        kept, on=("feature", "view"), how="left", maintain_order="left"
    )
    return joined["_kept"].fill_null(value=False)


def train_response(
    table: ObservationTable, target: str, *, model: WindowModel, better: Better | None = None
) -> WindowModel:
    """Learn how another quality of rings depends on their brightness.

    Parameters
    ----------
    table : ObservationTable
        Rows that have a value in column `target`; those that clip or stay dark included.
    target : str
        A numeric column: noise, form or diameter error, or anything else. Of an error that has a
        sign the size is learnt.
    model : WindowModel
        Of the same sensor and finish; its radiance model says how bright rings are.
    better : {'higher', 'lower'}, optional
        Which quality is better; known of the columns that are measured here.

    Returns
    -------
    WindowModel
        Predicts `target`, with the same forecasts as for p_norm.

    Raises
    ------
    ObservationError
        If there is no such column, or it has too few values.
    InputError
        If it is p_norm, which `train_window` learns, or it is not known which is better.
    """
    better = better or quantity(target).better
    if better is None or target == "p_norm":
        msg = (
            "p_norm is what the quality model itself predicts"
            if target == "p_norm"
            else f"say whether higher or lower {target} is better"
        )
        raise InputError(msg)
    radiance = model.radiance
    measured = table.measured().frame
    with_value = rows_of_quality(measured, target)
    frame = measured.filter(pl.col("feature").is_in(with_value["feature"].unique().implode()))
    rings, ring = radiance.rings(frame)
    log_radiance, _, _ = radiance.radiance(rings)
    log_brightness = log_radiance[ring] + np.log(frame["exposure_ms"].to_numpy())
    values = frame[target].cast(pl.Float64).fill_null(np.nan).to_numpy()
    kept = np.isfinite(values)
    low, high = measured_between(log_brightness, kept, target)
    kept &= (log_brightness >= low) & (log_brightness <= high)
    curve = ResponseCurve.fit(
        log_brightness[kept],
        np.abs(values[kept]) if quantity(target).signed else values[kept],
        better,
    )
    between = " to ".join(f"{each:.0f}" for each in np.exp(curve.span))
    return replace(
        model,
        name=f"{QUALITY}_{target}",
        title=f"{target} at {between} grey levels above black, where at least "
        f"{100 * LEAST_MEASURED:.0f} % of the captures measure it",
        target=target,
        window=curve,
        n_rows=int(kept.sum()),
    )

"""``exposight predict``: quality or exposure time from poses, one by one or as a table."""

from pathlib import Path
from typing import Annotated

import numpy as np
import polars as pl
from cyclopts import Parameter

from exposight.cli.app import UsageError
from exposight.cli.result import Fact, Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import FormatError, InputError, did_you_mean
from exposight.files import csv_pieces, write_durably
from exposight.models import I_AVG_MIN, Prediction, Predictor, load_model, unit_remarks
from exposight.observing import SCHEMA, read_inputs
from exposight.quantities import quantity
from exposight.tables import Column, Table, count, counted, number
from exposight.workers import Progress, ignore_progress

_SHOWN_ROWS = 20
_POSE = ("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "radius_mm")
_FEW_ROWS = 1000
"""So many are predicted at once; progress of more is shown."""

_MOST_INPUTS = 5
"""So many inputs are shown of rows without names; of more, none of turn and radius."""


def predict_command(
    model_file: Annotated[Path, Parameter("MODEL")],
    observations: Path | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    **inputs: float | str,
) -> Result:
    r"""Predict quality or exposure time from poses.

    Gives a new observation's mean (of exposure times the median) and 2σ band, and says where a
    prediction should not be relied on and why. quality predicts p_norm from pose and exposure time,
    exposure the time in ms that yields a brightness there; the paper's q_ models read the
    brightness i_avg.

    For example:

        exposight predict models/exposure.exposight-model --i-mean 90 --x-mm 10 \
          --y-mm -20 --z-mm 5 --w-deg 0 --p-deg -8 --radius-mm 5

        exposight predict models/quality.exposight-model planned.csv -o quality.csv

    Parameters
    ----------
    model_file
        Model file that train wrote.
    observations
        Table with the model's inputs, .csv or .parquet.
    output
        Write the predictions to this CSV file.
    inputs
        Or the inputs of one feature: i-mean or i-avg (grey level 0 to 255), x-mm, y-mm, z-mm
        (position in the TCP frame), w-deg, p-deg (orientation), radius-mm, exposure-ms, as the
        model reads them; feature, view, finish and others that it reads where they are given.
    """
    if (observations is None) == (not inputs):
        msg = "give a table of observations, or the inputs of one feature (--i-avg 90 …)"
        raise UsageError(msg)
    files: tuple[Written, ...] = ()
    if output is not None:
        if output.suffix.lower() != ".csv":
            msg = f"{output}: predictions are written as .csv, got '{output.suffix}'"
            raise FormatError(msg)
        files = (Written.at(output, "predictions", inputs=(observations, model_file)),)
    model = load_model(model_file)
    given = {name.replace("-", "_"): value for name, value in inputs.items()}
    table = (
        _one_row(model, given)
        if observations is None
        else read_inputs(observations, model.inputs, model.optional_inputs)
    )
    with progress_bars() as progress:
        few = table.height <= _FEW_ROWS
        frame, prediction = _predicted(model, table, ignore_progress if few else progress)
    if output is not None:
        write_durably(output, csv_pieces(frame))
    known = int(frame["known"].sum())
    low, middle, high = np.percentile(prediction.mean, [0, 50, 100]).tolist()
    return Result(
        title=f"{model.name}: {model.title}",
        facts=(
            fact("model", model.name, ""),
            fact("target", model.target, ""),
            fact("unit", quantity(model.target).unit, ""),
            fact("rows", table.height, f"{count(frame.height)} of {count(table.height)} predicted"),
            fact("known", known, f"{count(known)} of them near what was learnt"),
            fact(
                "predicted",
                {"min": low, "median": middle, "max": high},
                _summary(frame, model.target),
            ),
            fact("training_range", model.training_range, _ranges(model)),
            *_sensor_range(model),
        ),
        tables=(_prediction_table(model, frame, written=output is not None),),
        notes=tuple(_notes(model, table, frame, given)),
        files=files,
    )


def _sensor_range(model: Predictor) -> tuple[Fact, ...]:
    if model.target != "exposure_ms" or model.sensor is None:
        return ()
    low, high = model.sensor.exposure.min_ms, model.sensor.exposure.max_ms
    text = f"{low:g} to {high:g} ms of {model.sensor.name}"
    return (fact("sensor_range_ms", [low, high], text),)


def _one_row(model: Predictor, inputs: dict[str, float | str]) -> pl.DataFrame:
    """Return a frame with the inputs of one feature."""
    if missing := [name for name in model.inputs if name not in inputs]:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
        msg = f"{model.name} reads {', '.join(model.inputs)}; give the missing {options} too"
        raise UsageError(msg)
    read = (*model.inputs, *model.optional_inputs)
    if unknown := [name for name in inputs if name not in {*read, *SCHEMA}]:
        msg = f"{model.name} does not read {unknown[0]!r}, it reads {', '.join(model.inputs)}"
        raise UsageError(msg + did_you_mean(unknown[0], read))
    for name, value in inputs.items():
        if isinstance(value, str) and SCHEMA.get(name) != pl.String:
            msg = f"--{name.replace('_', '-')} takes a number, got {value!r}"
            raise UsageError(msg)
    texts = {name for name in inputs if SCHEMA.get(name) == pl.String}
    return pl.DataFrame(
        {
            name: [str(inputs[name]) if name in texts else inputs[name]]
            for name in read
            if name in inputs
        }
    )


def _predicted(
    model: Predictor, table: pl.DataFrame, progress: Progress
) -> tuple[pl.DataFrame, Prediction]:
    """Return what was asked and what is predicted, a row each, where all inputs are given."""
    names = model.inputs
    if table.height == 0:
        msg = "the table has no rows, so there is nothing to predict"
        raise InputError(msg)
    table = table.filter(
        pl.all_horizontal(pl.col(names).fill_null(np.nan).cast(pl.Float64).is_finite())
    )
    if table.height == 0:
        msg = f"no row has all inputs of {model.name}: {', '.join(names)}"
        raise InputError(msg)
    prediction = model.predict(table, progress=progress)
    target = model.target
    least = quantity(target).low
    reasons = model.unknown(table)
    frame = table.with_columns(
        pl.Series(f"predicted_{target}", prediction.mean),
        pl.Series(f"predicted_{target}_std", prediction.std),
        *(
            pl.Series(
                f"predicted_{target}_{end}", values if least is None else np.maximum(values, least)
            )
            for end, values in (("low", prediction.low), ("high", prediction.high))
        ),
        pl.Series("known", [not reason for reason in reasons]),
        pl.Series("unknown", reasons, dtype=pl.String),
    )
    if target == "exposure_ms" and (sensor := model.sensor) is not None:
        possible = (prediction.mean >= sensor.exposure.min_ms) & (
            prediction.mean <= sensor.exposure.max_ms
        )
        # An extrapolated exposure time is no setting to recommend.
        settings = [
            sensor.nearest_exposure(value) if good else None
            for value, good in zip(
                prediction.mean, possible & frame["known"].to_numpy(), strict=True
            )
        ]
        frame = frame.with_columns(
            pl.Series("in_sensor_range", possible),
            pl.Series("nearest_setting_ms", settings, dtype=pl.Float64),
        )
    return frame, prediction


def _notes(
    model: Predictor, table: pl.DataFrame, frame: pl.DataFrame, inputs: dict[str, float | str]
) -> list[str]:
    notes = [*unit_remarks(model, frame), *model.remarks(frame)]
    if left_out := table.height - frame.height:
        lack = "lacks" if left_out == 1 else "lack"
        notes.append(
            f"{counted(left_out, 'row')} {lack} an input, empty or not a number, and "
            f"{_are(left_out)} left out"
        )
    if "in_sensor_range" in frame.columns:
        beyond = frame.height - int(frame["in_sensor_range"].sum())
        if beyond:
            notes.append(
                f"{counted(beyond, 'exposure time')} {_are(beyond)} outside the sensor's range"
            )
    elif model.target == "exposure_ms":
        notes.append("the model names no sensor; train with --sensor to check its range")
    unknown = frame.filter(~pl.col("known"))
    if unknown.height:
        reason = unknown["unknown"][0]
        notes.append(
            f"do not trust this prediction: {reason}"
            if frame.height == 1
            else f"do not trust {counted(unknown.height, 'row')} that {_are(unknown.height)} not "
            f"known; the first: {reason} (--output writes why, row by row)"
        )
    if inputs:
        read = (*model.inputs, *model.optional_inputs)
        if unread := [each for each in inputs if each not in read]:
            notes.append(f"{model.name} does not read {', '.join(unread)}")
        grey = inputs.get("i_avg", 255.0)
        if model.target == "p_norm" and "i_avg" in model.inputs and float(grey) < I_AVG_MIN:
            notes.append(
                f"below grey level {I_AVG_MIN:g} the quality models predict 0 by design (Eq. 9)"
            )
    return notes


def _are(number_of_rows: int) -> str:
    return "is" if number_of_rows == 1 else "are"


def _summary(frame: pl.DataFrame, target: str) -> str:
    """Return the smallest, median and largest prediction, or of one row the band."""
    values = frame[f"predicted_{target}"].to_numpy()
    low, middle, high = (number(value) for value in np.percentile(values, [0, 50, 100]))
    unit = f" {quantity(target).suffix}".rstrip()
    if len(values) == 1:
        ends = (number(frame[f"predicted_{target}_{end}"][0], 3) for end in ("low", "high"))
        return f"{middle}{unit}, 2σ band {' to '.join(ends)}{unit}"
    return f"{low} to {high}{unit}, median {middle}{unit}"


def _ranges(model: Predictor) -> str:
    return "\n".join(
        f"{name} {number(low)} to {number(high)} {quantity(name).suffix}".rstrip()
        for name, (low, high) in model.training_range.items()
    )


def _prediction_table(model: Predictor, frame: pl.DataFrame, *, written: bool) -> Table:
    """Return what was measured, where it was, what the model reads and what it predicts."""
    target, inputs = model.target, model.inputs
    unit = f"\n{quantity(target).suffix}".rstrip()
    known = [
        name
        for name in ("feature", "view", target)
        if name in frame.columns and frame[name].null_count() < frame.height
    ]
    if "feature" in known:  # which says where it is
        inputs = tuple(name for name in inputs if name not in _POSE)
    elif len(inputs) > _MOST_INPUTS:
        inputs = tuple(name for name in inputs if name not in _POSE[3:])
    setting = ["nearest_setting_ms"] if "nearest_setting_ms" in frame.columns else []
    columns = (
        *(Column(name=name, digits=3, wraps=name == "view") for name in (*known, *inputs)),
        Column(name=f"predicted_{target}", label=f"predicted{unit}", digits=4),
        *(
            Column(name=f"predicted_{target}_{end}", label=f"{label}{unit}", digits=3)
            for end, label in (("low", "−2σ"), ("high", "+2σ"))
        ),
        *(Column(name=name, label="setting\nms") for name in setting),
        Column(name="known"),
    )
    limit = 0 if written else _SHOWN_ROWS
    return Table(name="predictions", frame=frame, columns=columns, shown_rows=limit)

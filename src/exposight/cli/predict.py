"""``exposight predict``: quality or exposure time from poses, one by one or as a table."""

import io
from pathlib import Path
from typing import Annotated

import numpy as np
import polars as pl
from cyclopts import Parameter

from exposight.cli.app import UsageError
from exposight.cli.result import Fact, Result, Written, fact
from exposight.errors import FormatError, InputError, did_you_mean
from exposight.files import write_durably
from exposight.models import I_AVG_MIN, Prediction, Predictor, load_model, unit_remarks
from exposight.observing import read_inputs
from exposight.quantities import QUANTITIES, quantity
from exposight.tables import Column, Table, count, counted, number

_SHOWN_ROWS = 20


def predict_command(
    model_file: Annotated[Path, Parameter("MODEL")],
    observations: Path | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    **inputs: float,
) -> Result:
    r"""Predict quality or exposure time from poses.

    Gives mean and twice the standard deviation of a new observation, and says whether the inputs
    lie in the range of the training data. A q_ model predicts p_norm; an e_ model the exposure time
    in ms that yields the brightness i_avg.

    For example:

        exposight predict models/e_k6.exposight-model --i-avg 90 --x-mm 10 \
          --y-mm -20 --z-mm 5 --w-deg 0 --p-deg -8

        exposight predict models/q_k4.exposight-model planned.csv -o quality.csv

    Parameters
    ----------
    model_file
        Model file that train wrote.
    observations
        Table with the model's inputs, .csv or .parquet.
    output
        Write the predictions to this CSV file.
    inputs
        Or the inputs of one feature: i-avg (grey level 0 to 255), x-mm, y-mm, z-mm (position in the
        TCP frame), w-deg, p-deg (orientation), as the model reads them.
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
        _one_row(model, given) if observations is None else read_inputs(observations, model.inputs)
    )
    frame, prediction = _predicted(model, table)
    if output is not None:
        buffer = io.BytesIO()
        frame.write_csv(buffer)
        write_durably(output, buffer.getvalue())
    inside = int(np.count_nonzero(prediction.inside))
    low, middle, high = np.percentile(prediction.mean, [0, 50, 100]).tolist()
    return Result(
        title=f"{model.name}: {model.title}",
        facts=(
            fact("model", model.name, ""),
            fact("target", model.target, ""),
            fact("unit", quantity(model.target).unit, ""),
            fact("rows", table.height, f"{count(frame.height)} of {count(table.height)} predicted"),
            fact("inside_training_range", inside, f"{count(inside)} within the training data"),
            fact(
                "predicted",
                {"min": low, "median": middle, "max": high},
                _summary(model.target, prediction),
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


def _one_row(model: Predictor, inputs: dict[str, float]) -> pl.DataFrame:
    """Return a frame with the inputs of one feature."""
    if missing := [name for name in model.inputs if name not in inputs]:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
        msg = f"{model.name} reads {', '.join(model.inputs)}; give the missing {options} too"
        raise UsageError(msg)
    if unknown := [name for name in inputs if name not in {*model.inputs, *QUANTITIES}]:
        msg = f"{model.name} does not read {unknown[0]!r}, it reads {', '.join(model.inputs)}"
        raise UsageError(msg + did_you_mean(unknown[0], model.inputs))
    return pl.DataFrame({name: [inputs[name]] for name in model.inputs})


def _predicted(model: Predictor, table: pl.DataFrame) -> tuple[pl.DataFrame, Prediction]:
    """Return what was asked and what is predicted, a row each, where all inputs are given."""
    names = model.inputs
    if table.height == 0:
        msg = "the table has no rows, so there is nothing to predict"
        raise InputError(msg)
    table = table.filter(
        pl.all_horizontal(pl.col(names).fill_null(np.nan).cast(pl.Float64).is_finite())
    )
    ranges = model.training_range
    if table.height == 0:
        msg = f"no row has all inputs of {model.name}: {', '.join(names)}"
        raise InputError(msg)
    prediction = model.predict(table)
    target = model.target
    outside = [
        " ".join(name for name, (low, high) in ranges.items() if not low <= row[name] <= high)
        for row in table.iter_rows(named=True)
    ]
    frame = table.with_columns(
        pl.Series(f"predicted_{target}", prediction.mean),
        pl.Series(f"predicted_{target}_std", prediction.std),
        pl.Series(f"predicted_{target}_low", prediction.low),
        pl.Series(f"predicted_{target}_high", prediction.high),
        pl.Series("inside_training_range", prediction.inside),
        pl.Series("outside", outside),
    )
    if target == "exposure_ms" and (sensor := model.sensor) is not None:
        possible = (prediction.mean >= sensor.exposure.min_ms) & (
            prediction.mean <= sensor.exposure.max_ms
        )
        # An extrapolated exposure time is no setting to recommend.
        settings = [
            sensor.nearest_exposure(value) if good else None
            for value, good in zip(prediction.mean, possible & prediction.inside, strict=True)
        ]
        frame = frame.with_columns(
            pl.Series("in_sensor_range", possible),
            pl.Series("nearest_setting_ms", settings, dtype=pl.Float64),
        )
    return frame, prediction


def _notes(
    model: Predictor, table: pl.DataFrame, frame: pl.DataFrame, inputs: dict[str, float]
) -> list[str]:
    name, notes = model.name, list(unit_remarks(model, frame))
    if left_out := table.height - frame.height:
        lack, are = ("lacks", "is") if left_out == 1 else ("lack", "are")
        notes.append(
            f"{counted(left_out, 'row')} {lack} an input, empty or not a number, and {are} left out"
        )
    if "in_sensor_range" in frame.columns:
        beyond = frame.height - int(frame["in_sensor_range"].sum())
        if beyond:
            are = "is" if beyond == 1 else "are"
            notes.append(f"{counted(beyond, 'exposure time')} {are} outside the sensor's range")
    elif model.target == "exposure_ms":
        notes.append("the model names no sensor; train with --sensor to check its range")
    if inputs:
        if outside := frame["outside"][0].replace(" ", ", "):
            notes.append(
                f"{outside} outside the training data: the model extrapolates, do not trust it here"
            )
        if unread := [each for each in inputs if each not in model.inputs]:
            notes.append(f"{name} does not read {', '.join(unread)}")
        if model.target == "p_norm" and inputs.get("i_avg", 255.0) < I_AVG_MIN:
            notes.append(
                f"below grey level {I_AVG_MIN:g} the quality models predict 0 by design (Eq. 9)"
            )
    return notes


def _summary(target: str, prediction: Prediction) -> str:
    """Return the smallest, median and largest prediction, and how certain they are."""
    low, middle, high = (number(value) for value in np.percentile(prediction.mean, [0, 50, 100]))
    unit = f" {quantity(target).suffix}".rstrip()
    sigma = number(2 * float(np.median(prediction.std)), 3)
    if len(prediction.mean) == 1:
        return f"{middle} ± {sigma}{unit} (2σ)"
    return f"{low} to {high}{unit}, median {middle} ± {sigma}{unit} (2σ)"


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
    setting = ["nearest_setting_ms"] if "nearest_setting_ms" in frame.columns else []
    columns = (
        *(Column(name=name, digits=3, wraps=name == "view") for name in (*known, *inputs)),
        Column(name=f"predicted_{target}", label=f"predicted{unit}", digits=4),
        Column(name=f"predicted_{target}_std", label=f"± 2σ{unit}", digits=3, scale=2.0),
        *(Column(name=name, label="setting\nms") for name in setting),
        Column(name="outside", wraps=True),
    )
    limit = 0 if written else _SHOWN_ROWS
    return Table(name="predictions", frame=frame, columns=columns, shown_rows=limit)

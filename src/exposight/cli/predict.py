"""``exposight predict``: quality or exposure time for poses, one by one or as a table."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

from exposight.cli.arguments import keep_inputs
from exposight.cli.exposure_units import exposure_unit_remark
from exposight.cli.facts import short_unit
from exposight.cli.output import (
    JsonOption,
    count,
    counted,
    note,
    number,
    print_facts,
    print_json,
    print_line,
    print_table,
    wrote,
)
from exposight.cli.position_units import position_unit_remark
from exposight.errors import FormatError, InputError
from exposight.files.durable import write_durably
from exposight.models import I_AVG_MAX, I_AVG_MIN, GaussianProcessModel, load_model
from exposight.observing import read_inputs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exposight.models import GaussianProcessModel, Prediction

_SHOWN_ROWS = 20


def _input(text: str) -> Any:
    return typer.Option(metavar="NUMBER", help=text, rich_help_panel="Or one feature")


_Model = Annotated[Path, typer.Argument(metavar="MODEL", help="Model file that train wrote.")]
_Observations = Annotated[
    Path | None,
    typer.Argument(metavar="OBSERVATIONS", help="Table with the model's inputs, .csv or .parquet."),
]
_IAvg = Annotated[float | None, _input("Mean grey value of the ring, 0 to 255.")]
_X = Annotated[float | None, _input("Position in the TCP frame, mm.")]
_Y = Annotated[float | None, _input("Position in the TCP frame, mm.")]
_Z = Annotated[float | None, _input("Position in the TCP frame, mm; negative is nearer.")]
_W = Annotated[float | None, _input("Orientation about x, degrees.")]
_P = Annotated[float | None, _input("Orientation about y, degrees.")]
_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="CSV", help="Write all predictions of a table here."),
]


def predict_command(
    model_file: _Model,
    observations: _Observations = None,
    output: _Output = None,
    as_json: JsonOption = False,
    i_avg: _IAvg = None,
    x_mm: _X = None,
    y_mm: _Y = None,
    z_mm: _Z = None,
    w_deg: _W = None,
    p_deg: _P = None,
) -> None:
    r"""Predict quality or exposure time, and say how far to believe it.

    Mean and twice the standard deviation of a new observation, and whether the
    inputs lie in the range of the training data. A q_ model predicts p_norm; an
    e_ model the exposure time in ms that yields the brightness i_avg.

    For example:

      exposight predict models/e_k6.exposight-model --i-avg 90 --x-mm 10 \
        --y-mm -20 --z-mm 5 --w-deg 0 --p-deg -8

      exposight predict models/q_k4.exposight-model planned.csv -o quality.csv
    """
    given = {
        "i_avg": i_avg,
        "x_mm": x_mm,
        "y_mm": y_mm,
        "z_mm": z_mm,
        "w_deg": w_deg,
        "p_deg": p_deg,
    }
    inputs = {name: value for name, value in given.items() if value is not None}
    if (observations is None) == (not inputs):
        msg = "give a table of observations, or the inputs of one feature (--i-avg 90 …)"
        raise typer.BadParameter(msg)
    if observations is None and output is not None:
        msg = "--output is for the predictions of a table"
        raise typer.BadParameter(msg)
    if output is not None:
        keep_inputs(output, observations, model_file)
    model = load_model(model_file, GaussianProcessModel)
    if observations is None:
        _predict_one(model, inputs, as_json=as_json)
    else:
        table = read_inputs(observations, model.inputs)
        _predict(model, table, output, as_json=as_json)


# -- one feature --------------------------------------------------------------------------------


def _predict_one(model: GaussianProcessModel, inputs: dict[str, float], *, as_json: bool) -> None:
    specification = model.specification
    missing = [name for name in specification.inputs if name not in inputs]
    if missing:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in missing)
        msg = (
            f"{specification.name} reads {', '.join(specification.inputs)}; "
            f"give the missing {options} too"
        )
        raise typer.BadParameter(msg)
    grey = inputs.get("i_avg", 0.0)
    if not 0 <= grey <= I_AVG_MAX:
        msg = f"--i-avg is a mean grey value from 0 to {I_AVG_MAX:g}, got {grey:g}"
        raise typer.BadParameter(msg)
    ignored = [name for name in inputs if name not in specification.inputs]
    x = np.array([[inputs[name] for name in specification.inputs]])
    prediction = model.predict(**{name: inputs[name] for name in specification.inputs})
    mean, std = float(prediction.mean[0]), float(prediction.std[0])
    outside = _outside(model, x)[0]
    if as_json:
        print_json(
            {
                "model": specification.name,
                "target": specification.target,
                "unit": model.unit,
                "mean": mean,
                "std": std,
                "inside_training_range": bool(prediction.inside[0]),
                "outside": outside,
                "training_range": model.training_range,
                "ignored_inputs": ignored,
                **_exposure_document(model, mean, trusted=not outside),
            }
        )
        return
    name: str = specification.target
    facts = [(name, f"{number(mean)} ± {number(2 * std, 3)} {short_unit(name)}".rstrip() + " (2σ)")]
    ranges = model.training_range
    for name in specification.inputs:
        low, high = ranges[name]
        verdict = "OUTSIDE" if name in outside else "inside"
        facts.append(
            (name, f"{number(inputs[name])}, {verdict} {number(low)} … {number(high)} of training")
        )
    facts += _sensor_facts(model, mean, trusted=not outside)
    if specification.target == "p_norm" and grey < I_AVG_MIN:
        note(f"below a grey level of {I_AVG_MIN:g} the quality models say 0 by design (Eq. 9)")
    print_facts(f"{specification.name}: {specification.title}", facts)
    if outside:
        note(
            f"{', '.join(outside)} outside the training data: the model extrapolates, and is not "
            "to be trusted here"
        )
    if ignored:
        note(f"{specification.name} does not read {', '.join(ignored)}")


def _exposure_document(
    model: GaussianProcessModel, mean: float, *, trusted: bool
) -> dict[str, object]:
    """Return what the sensor makes of a predicted exposure time, no setting if extrapolated."""
    if model.target != "exposure_ms":
        return {}
    sensor = model.sensor
    if sensor is None:
        return {"sensor_range_ms": None, "in_sensor_range": None, "nearest_setting_ms": None}
    inside = sensor.exposure.min_ms <= mean <= sensor.exposure.max_ms
    return {
        "sensor_range_ms": [sensor.exposure.min_ms, sensor.exposure.max_ms],
        "in_sensor_range": inside,
        "nearest_setting_ms": sensor.nearest_exposure(mean) if inside and trusted else None,
    }


def _sensor_facts(
    model: GaussianProcessModel, mean: float, *, trusted: bool
) -> list[tuple[str, str]]:
    """Say what the sensor makes of a predicted exposure time."""
    if model.target != "exposure_ms":
        return []
    sensor = model.sensor
    if sensor is None:
        return [("sensor", "the model names none; train with --sensor to check its range")]
    low, high = sensor.exposure.min_ms, sensor.exposure.max_ms
    span = f"{low:g} … {high:g} ms of {sensor.name}"
    if not low <= mean <= high:
        return [("sensor", f"OUTSIDE {span}: it cannot take this exposure")]
    setting = f"{sensor.nearest_exposure(mean):g} ms" if trusted else "none: it is extrapolated"
    return [("sensor", f"inside {span}"), ("setting", setting)]


def _outside(model: GaussianProcessModel, x: NDArray[np.float64]) -> list[list[str]]:
    """Return, for each of (n, d) inputs, the names of those outside the training range."""
    ranges = np.array(list(model.training_range.values()))
    beyond = (x < ranges[:, 0]) | (x > ranges[:, 1])
    names = np.array(model.inputs, dtype=object)
    return [names[row].tolist() for row in beyond]


# -- a table ------------------------------------------------------------------------------------


def _predict(
    model: GaussianProcessModel, table: pl.DataFrame, output: Path | None, *, as_json: bool
) -> None:
    asked = table.select(pl.col(model.inputs).fill_null(np.nan))
    x = asked.to_numpy().reshape(-1, len(model.inputs))
    complete: NDArray[np.bool_] = np.asarray(np.isfinite(x).all(axis=1))
    if table.height == 0:
        msg = "the table has no rows, so there is nothing to predict"
        raise InputError(msg)
    if not complete.any():
        msg = f"no row has all inputs of {model.name}: {', '.join(model.inputs)}"
        raise InputError(msg)
    prediction = model.predict(table.filter(pl.Series(complete)))
    frame = _frame(model, table.filter(pl.Series(complete)), x[complete], prediction)
    replaced = output is not None and output.exists()
    if output is not None:
        _write(output, frame)
    left_out = int(np.count_nonzero(~complete))
    inside = int(np.count_nonzero(prediction.inside))
    remarks = (
        exposure_unit_remark(model, table["exposure_ms"].fill_null(np.nan)),
        position_unit_remark(model, table.filter(pl.Series(complete))),
    )
    remark = "; ".join(filter(None, remarks))
    if as_json:
        print_json(
            {
                "model": model.name,
                "target": model.target,
                "unit": model.unit,
                "rows": len(table),
                "without_inputs": left_out,
                "inside_training_range": inside,
                "remark": remark,
                "predictions": frame.to_dicts(),
                "output": output,
                "replaced": replaced,
            }
        )
        return
    specification = model.specification
    print_facts(
        f"{specification.name}: {specification.title}",
        [
            ("predicted", f"{count(frame.height)} of {counted(len(table), 'row')}"),
            ("inside", f"{count(inside)} in the range of the training data"),
            (specification.target, _summary(specification.target, prediction)),
        ],
    )
    if remark:
        note(remark)
    if left_out:
        lack = "lacks" if left_out == 1 else "lack"
        note(
            f"{counted(left_out, 'row')} {lack} an input, empty or not a number, and "
            f"{'is' if left_out == 1 else 'are'} left out"
        )
    if "in_sensor_range" in frame.columns:
        beyond = int((~frame["in_sensor_range"].fill_null(value=True)).sum())
        if beyond:
            are = "is" if beyond == 1 else "are"
            note(f"{counted(beyond, 'exposure time')} {are} outside the sensor's range")
    if output is not None:
        wrote("predictions", output, replaced=replaced)
    else:
        _print_rows(model, frame)


def _frame(
    model: GaussianProcessModel,
    table: pl.DataFrame,
    x: NDArray[np.float64],
    prediction: Prediction,
) -> pl.DataFrame:
    """Return what was asked and what is predicted, a row each."""
    target = model.target
    frame = table.with_columns(
        pl.Series(f"predicted_{target}", prediction.mean),
        pl.Series(f"predicted_{target}_std", prediction.std),
        pl.Series("inside_training_range", prediction.inside),
        pl.Series("outside", [" ".join(names) for names in _outside(model, x)]),
    )
    if target == "exposure_ms" and model.sensor is not None:
        low, high = model.sensor.exposure.min_ms, model.sensor.exposure.max_ms
        in_range = pl.col(f"predicted_{target}").is_between(low, high)
        frame = frame.with_columns(in_range.alias("in_sensor_range"))
    return frame


def _write(path: Path, frame: pl.DataFrame) -> None:
    if path.suffix.lower() != ".csv":
        msg = f"{path}: predictions are written as .csv, got '{path.suffix}'"
        raise FormatError(msg)
    buffer = io.BytesIO()
    frame.write_csv(buffer)
    write_durably(path, buffer.getvalue())


def _summary(target: str, prediction: Prediction) -> str:
    """Spell the smallest, middle and largest prediction, and how far to believe them."""
    low, middle, high = (number(own) for own in np.percentile(prediction.mean, [0, 50, 100]))
    unit = f" {short_unit(target)}".rstrip()
    sigma = number(2 * float(np.median(prediction.std)), 3)
    return f"{low} … {high}{unit}, median {middle} ± {sigma}{unit} (2σ)"


def _print_rows(model: GaussianProcessModel, frame: pl.DataFrame) -> None:
    target = model.target
    unit = f"\n{short_unit(target)}"
    # What was measured, where it was, and what the model reads.
    names = [own for own in ("feature", "view") if frame[own].null_count() < frame.height]
    known = [own for own in (target,) if frame[own].null_count() < frame.height]
    inputs = model.inputs
    print_line("")
    print_table(
        (
            *names,
            *(_heading(own) for own in (*known, *inputs)),
            f"predicted{unit}",
            f"± 2σ{unit}",
            "outside",
        ),
        (
            (
                *(row[own] or "–" for own in names),
                *(number(row[own], 3) for own in (*known, *inputs)),
                number(row[f"predicted_{target}"]),
                number(2 * row[f"predicted_{target}_std"], 3),
                row["outside"],
            )
            for row in frame.head(_SHOWN_ROWS).iter_rows(named=True)
        ),
        words=("view", "outside"),
    )
    if frame.height > _SHOWN_ROWS:
        print_line(f"  … {count(frame.height - _SHOWN_ROWS)} more; --output writes them all")


def _heading(column: str) -> str:
    """Return a column's name over its unit."""
    name, _, unit = column.rpartition("_")
    return f"{name}\n{short_unit(column)}" if unit in {"ms", "mm", "deg"} else column

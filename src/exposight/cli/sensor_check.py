"""``exposight simulate --check``: a simulated sensor measures itself."""

from dataclasses import asdict
from math import isnan
from pathlib import Path

from exposight.cell import ActiveSensor, preset_name
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.report import write_sensor_check
from exposight.tables import Column, Table, number
from exposight.twin import SimulatedCellSettings
from exposight.twin.check import GOOD_P_NORM, SensorCheck, check_sensor


def check_and_write(
    sensor: ActiveSensor, cell: SimulatedCellSettings | None, output: Path
) -> Result:
    """Measure a simulated sensor, write the page, and return the same figures."""
    file = Written.at(output, "page")
    with progress_bars() as progress:
        check = check_sensor(sensor, cell, progress=progress)
    write_sensor_check(check, output)
    clips_ms = check.matt_white.clips_at_ms
    rises, falls = check.ring.crossings(GOOD_P_NORM)
    return Result(
        title=check.verdict,
        facts=(
            fact("sensor", preset_name(sensor) or sensor.name),
            fact("agrees", not check.deviating),
            fact("verdict", check.verdict, ""),
            fact(
                "white_clips_at_ms",
                clips_ms,
                "never" if isnan(clips_ms) else f"{number(clips_ms, 3)} ms",
            ),
            fact("p_norm_rises_at", rises, f"{number(rises, 3)} grey levels"),
            fact("p_norm_falls_at", falls, f"{number(falls, 3)} grey levels"),
        ),
        tables=_tables(check),
        notes=check.remarks,
        files=(file,),
    )


def _tables(check: SensorCheck) -> tuple[Table, ...]:
    figures = (
        {
            "figure": figure.name,
            "label": figure.label,
            **{name: getattr(figure, name) for name in ("unit", "measured", "expected")},
            **{name: getattr(figure, name) for name in ("deviation", "tolerance", "agrees")},
        }
        for figure in check.figures
    )
    ring = check.ring
    ring_rows = (
        {"exposure_ms": t, "i_avg": i, "p_norm": p}
        for t, i, p in zip(
            ring.exposure_ms.tolist(), ring.i_avg.tolist(), ring.p_norm.tolist(), strict=True
        )
    )
    return (
        Table.of(
            "figures",
            figures,
            (
                Column(name="label", label="figure", wraps=True),
                Column(name="measured"),
                Column(name="expected", label="table"),
                Column(name="unit"),
                Column(name="agrees"),
            ),
        ),
        Table.of(
            "plates",
            map(asdict, check.plates),
            (
                Column(name="distance_mm", decimals=0),
                Column(name="exposure_ms"),
                Column(name="covered_share", label="covered\n%", scale=100, decimals=1),
                Column(name="points_share", label="points\n%", scale=100, decimals=1),
                Column(name="bias_mm", decimals=4),
                Column(name="noise_mm", decimals=4),
                Column(name="repeat_noise_mm", label="between\ncaptures", decimals=4),
                Column(name="predicted_noise_mm", label="predicted", decimals=4),
            ),
            title="Depth of a plate in primer",
        ),
        Table.of(
            "ring",
            ring_rows,
            tuple(Column(name=name) for name in ("exposure_ms", "i_avg", "p_norm")),
            title="A ring at the TCP",
        ),
    )

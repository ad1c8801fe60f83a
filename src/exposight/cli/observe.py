"""``exposight observe``: captures to a table of observations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from exposight.cell import PAPER_TOLERANCE, PRESETS, CampaignFolder, RingTolerance
from exposight.cli.arguments import keep_inputs
from exposight.cli.output import (
    JsonOption,
    count,
    note,
    number,
    percent,
    print_facts,
    print_json,
    print_line,
    print_table,
    progress_bars,
)
from exposight.cli.single_capture import CloudUnit, SingleCapture
from exposight.errors import FormatError
from exposight.geometry import POSE_CONVENTIONS
from exposight.observing import Visibility, observe_campaign

if TYPE_CHECKING:
    from exposight.cell import CaptureSource
    from exposight.observing import ObservationTable

_COLUMNS = {
    "exposure_ms": "exposure time, ms",
    "p_norm": "p_norm, share of the ring with points",
    "i_avg": "i_avg, mean grey of the ring, 0–255",
    "x_mm": "x in the TCP frame, mm",
    "y_mm": "y in the TCP frame, mm",
    "z_mm": "z in the TCP frame, mm",
    "w_deg": "w about x, °",
    "p_deg": "p about y, °",
    "incidence_deg": "line of sight to normal, °",
    "radius_mm": "radius, mm",
}
_FEW_ROWS = 24
"""So many observations are shown one by one."""


def _single(metavar: str, text: str) -> Any:
    """Return an option of a capture that stands alone."""
    panel = "Or a single capture, without a campaign folder"
    return typer.Option(metavar=metavar, help=text, rich_help_panel=panel)


_Campaign = Annotated[Path | None, typer.Argument(metavar="CAMPAIGN", help="A campaign's folder.")]
_Output = Annotated[
    Path,
    typer.Option("--output", "-o", metavar="FILE", help="Observation table: .csv or .parquet."),
]
_Height = Annotated[
    float, typer.Option("--height", metavar="MM", help="Height of the hollow cylinder, mm.")
]
_Inner = Annotated[
    float,
    typer.Option("--inner", metavar="MM", help="The ring begins so far outside the edge, mm."),
]
_Outer = Annotated[
    float, typer.Option("--outer", metavar="MM", help="The ring ends so far outside the edge, mm.")
]
_Image = Annotated[Path | None, _single("FILE", "Stripe image, grey.")]
_BitDepth = Annotated[int | None, _single("BITS", "Of the image: 8 (default), 10, 12 or 16.")]
_Cloud = Annotated[Path | None, _single("FILE", "Point cloud in the camera's frame.")]
_CloudUnit = Annotated[
    CloudUnit | None, _single("UNIT", "Of the cloud: mm (default), cm or m; files do not tell.")
]
_Features = Annotated[Path | None, _single("CSV", "The part's features (docs/formats.md).")]
_Sensor = Annotated[
    str | None, _single("NAME|FILE", f"The sensor: {', '.join(PRESETS)}, or its JSON file.")
]
_Exposure = Annotated[float | None, _single("MS", "Exposure time, ms.")]
_Pose = Annotated[
    Path | None,
    _single("FILE", "Pose of the part in the camera's frame: a text file, 4×4 matrix, mm."),
]
_RobotPose = Annotated[
    tuple[str, str] | None,
    _single(
        "ROBOT NUMBERS",
        "The same as a robot writes it: "
        + "; ".join(f"{name} {numbers}" for name, (numbers, _) in POSE_CONVENTIONS.items())
        + ".",
    ),
]


def observe_command(
    campaign: _Campaign = None,
    output: _Output = Path("observations.csv"),
    height_mm: _Height = PAPER_TOLERANCE.height_mm,
    inner_mm: _Inner = PAPER_TOLERANCE.inner_mm,
    outer_mm: _Outer = PAPER_TOLERANCE.outer_mm,
    as_json: JsonOption = False,
    image: _Image = None,
    bit_depth: _BitDepth = None,
    cloud: _Cloud = None,
    cloud_unit: _CloudUnit = None,
    features: _Features = None,
    sensor: _Sensor = None,
    exposure_ms: _Exposure = None,
    pose: _Pose = None,
    robot_pose: _RobotPose = None,
) -> None:
    r"""Measure every feature in every capture: quality, brightness, pose.

    p_norm is the share of the ring around a feature that has 3D points, i_avg
    the ring's mean grey value; the pose is the feature's in the sensor's TCP
    frame. Features that cannot be measured stay in the table with the reason.

    For example:

      exposight observe door-inside/ -o observations.csv

      exposight observe --image stripes.png --cloud cloud.ply \
        --features features.csv --sensor comet-pro-ae --exposure-ms 10 \
        --robot-pose fanuc 12.5,-3,600,0,0,90
    """
    tolerance = RingTolerance(height_mm=height_mm, inner_mm=inner_mm, outer_mm=outer_mm)
    single = SingleCapture(
        image=image,
        bit_depth=bit_depth,
        cloud=cloud,
        cloud_unit=cloud_unit,
        features=features,
        sensor=sensor,
        exposure_ms=exposure_ms,
        pose=pose,
        robot_pose=robot_pose,
    )
    keep_inputs(output, image, cloud, features, pose)
    source = _source(campaign, single)
    with progress_bars() as progress:
        table = observe_campaign(source, tolerance, progress=progress)
    table.write(output)
    if as_json:
        print_json(_document(source, table, output))
    else:
        _print(source, table, output)


def _source(campaign: Path | None, single: SingleCapture) -> CaptureSource:
    """Return what is to be observed: a campaign's folder, or else a single capture."""
    if campaign is None:
        return single.campaign()
    if given := single.given():
        msg = f"give a campaign's folder or a single capture, not both (got {', '.join(given)})"
        raise typer.BadParameter(msg)
    if campaign.is_file() and campaign.suffix.lower() in {".csv", ".parquet"}:
        msg = f"{campaign}: a table; expected a campaign's folder, which has a campaign.json"
        raise FormatError(msg)
    return CampaignFolder(campaign)


def _ranges(table: ObservationTable) -> dict[str, tuple[float, float, float]]:
    """Return the smallest, middle and largest value of each column over the measured rows."""
    measured = table.measured()
    if len(measured) == 0:
        return {}
    values = measured.array(list(_COLUMNS))
    low, middle, high = np.nanpercentile(values, [0, 50, 100], axis=0).tolist()
    return dict(zip(_COLUMNS, zip(low, middle, high, strict=True), strict=True))


def _document(source: CaptureSource, table: ObservationTable, output: Path) -> dict[str, object]:
    return {
        "campaign": source.name,
        "sensor": source.sensor.name,
        "part": source.part.name,
        "features": len(source.part.features),
        "captures": len(source),
        "rows": len(table),
        "visibility": table.counts(),
        "emulated_rows": int(table.frame["emulated"].sum()),
        "ranges": {
            name: dict(zip(("min", "median", "max"), values, strict=True))
            for name, values in _ranges(table).items()
        },
        "observations": output,
    }


def _print(source: CaptureSource, table: ObservationTable, output: Path) -> None:
    emulated = int(table.frame["emulated"].sum())
    print_facts(
        f"{source.name}: part {source.part.name}, {source.sensor.name}",
        [
            ("captures", count(len(source))),
            ("features", count(len(source.part.features))),
            ("observations", f"{count(len(table))}, of which {count(emulated)} emulated"),
        ],
    )
    print_line("")
    print_table(
        ("features are", "rows", "share %"),
        (
            (reason, count(rows), percent(rows / len(table)))
            for reason, rows in table.counts().items()
        ),
    )
    print_line("")
    ranges = _ranges(table)
    if len(table) <= _FEW_ROWS:
        _print_rows(table)
    elif ranges:
        print_table(
            ("measured", "min", "median", "max"),
            ((_COLUMNS[name], *map(number, values)) for name, values in ranges.items()),
        )
    if not ranges:
        note("no feature could be measured; check the pose and its unit")
    elif not (table.frame["p_norm"].fill_null(0.0) > 0.0).any():
        note(
            "every p_norm is 0: no point of any cloud lies near any feature. If the images are not "
            "all dark or clipped, check that features are in mm, and clouds too (if not, say "
            "--cloud-unit), that clouds are in the camera's frame, and that the pose is that of "
            "the part seen from the camera"
        )
    print_line(f"wrote the observations: {output}")


def _print_rows(table: ObservationTable) -> None:
    """Print each observation: what one wants to see of a single capture."""
    columns = ("p_norm", "i_avg", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
    headings = ("p_norm", "i_avg\n0–255", "x\nmm", "y\nmm", "z\nmm", "w\n°", "p\n°")
    digits = (3, 3, 4, 4, 4, 3, 3)
    print_table(
        ("feature", "exposure\nms", *headings, "measured"),
        (
            (
                row["feature"],
                number(row["exposure_ms"]),
                *(number(row[name], n) for name, n in zip(columns, digits, strict=True)),
                "yes" if row["visibility"] == Visibility.VISIBLE else row["visibility"],
            )
            for row in table.frame.iter_rows(named=True)
        ),
        words=("measured",),
    )

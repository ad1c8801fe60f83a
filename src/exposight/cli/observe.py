"""``exposight observe``: captures to a table of observations."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import polars as pl
from cyclopts import Group, Parameter

from exposight import cell
from exposight.cli.app import UsageError
from exposight.cli.capture_options import CaptureOptions
from exposight.cli.pose import PoseOptions
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import FormatError
from exposight.files import spelled
from exposight.observing import ObservationTable, observe_campaign
from exposight.tables import Column, Table, count

_RANGES = (
    *("exposure_ms", "p_norm", "i_avg", "x_mm", "y_mm", "z_mm"),
    *("w_deg", "p_deg", "incidence_deg", "radius_mm"),
)
_FEW_ROWS = 24
"""So many observations are shown one by one."""


@Parameter("*", group=Group("Or a single capture, without a campaign folder", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class SingleCapture(PoseOptions, CaptureOptions):
    """A capture that stands alone: its files and numbers on the command line.

    Parameters
    ----------
    image
        Image in which brightness is averaged, grey.
    cloud
        Point cloud in the camera's frame, or depth image (.png, .tif, .npy) of the camera.
    features
        The part's features, CSV (docs/formats.md).
    sensor
        Name of a preset (comet-pro-ae, rc-visard-65) or JSON file of a sensor.
    exposure_ms
        Exposure time, ms.
    """

    image: Path | None = None
    cloud: Path | None = None
    features: Path | None = None
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None
    exposure_ms: float | None = None

    def options(self) -> list[str]:
        """Return the options that were given."""
        return [
            f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value is not None
        ]

    def source(self) -> cell.MemoryCampaign:
        """Read the files and return a campaign of this one capture.

        Raises
        ------
        UsageError
            If an option is missing, or the pose is given twice.
        ExposightError
            If a file cannot be used.
        """
        if (
            self.image is None
            or self.cloud is None
            or self.features is None
            or self.sensor is None
            or self.exposure_ms is None
            or not self.has_pose
        ):
            raise UsageError(self._missing())
        sensor = cell.sensor_named_or_read(self.sensor)
        form = self.form
        part = cell.Part(
            name=spelled(self.features.stem), features=cell.read_features(self.features)
        )
        capture = cell.Capture(
            view=spelled(self.image.stem),
            exposure_ms=self.exposure_ms,
            image=form.image(self.image),
            cloud=form.cloud(self.cloud, sensor),
            camera_from_part=self.camera_from_part_seen(part, sensor),
            bit_depth=form.bit_depth,
            brightness_source=form.brightness_source,
        )
        self.check_chain(capture, part, sensor)
        return cell.MemoryCampaign(
            name=str(self.image), sensor=sensor, part=part, captures=[capture]
        )

    def _missing(self) -> str:
        needed = ("--image", "--cloud", "--features", "--sensor", "--exposure-ms")
        given = self.options()
        if not given:
            return (
                f"give a campaign's folder, or a single capture by {', '.join(needed)} and --pose "
                "or --robot-pose"
            )
        missing = [option for option in needed if option not in given]
        if not self.has_pose:
            missing.append("--pose, --robot-pose or --flange")
        return f"a single capture also needs {', '.join(missing)}"


_NO_CAPTURE = SingleCapture()
_REGION = Parameter("*", group=Group("Measured region", sort_key=2))


def observe_command(
    campaign: Path | None = None,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o")] = Path("observations.csv"),
    finish: str | None = None,
    tolerance: Annotated[cell.RingTolerance, _REGION] = cell.PAPER_TOLERANCE,
    despite: tuple[str, ...] = (),
    single: SingleCapture = _NO_CAPTURE,
) -> Result:
    r"""Measure quality, brightness and pose of every feature in every capture.

    p_norm is the share of the ring around a feature that has 3D points, i_avg the ring's mean grey
    level; the pose is the feature's in the sensor's TCP frame. Features that cannot be measured
    stay in the table with the reason.

    For example:

        exposight observe door-inside/ -o observations.csv

        exposight observe --image stripes.png --cloud cloud.ply \
          --features features.csv --sensor comet-pro-ae --exposure-ms 10 \
          --robot-pose fanuc 12.5,-3,600,0,0,90

    Parameters
    ----------
    campaign
        A campaign's folder.
    output
        Observation table to write: .csv or .parquet.
    finish
        Name of the surface that all features are on, such as primer; by default what the campaign
        says of each.
    despite
        Go on in spite of contradictory inputs: names of checks (docs/contradictions.md).
    """
    if finish is not None and not finish.strip():
        msg = "--finish needs the name of a surface, such as primer"
        raise UsageError(msg)
    inputs = (single.image, single.cloud, single.features, single.pose)
    file = Written.at(output, "observations", inputs=inputs)
    source = _source(campaign, single)
    with progress_bars() as progress:
        table = observe_campaign(source, tolerance, progress=progress, despite=despite)
    if finish is not None:
        table = replace(table, frame=table.frame.with_columns(finish=pl.lit(finish.strip())))
    table.write(output)
    emulated = int(table.frame["emulated"].sum())
    return Result(
        title=f"{source.name}: part {source.part.name}, {source.sensor.name}",
        facts=(
            fact("campaign", source.name, ""),
            fact("sensor", source.sensor.name, ""),
            fact("part", source.part.name, ""),
            fact("captures", len(source)),
            fact("features", len(source.part.features)),
            fact("rows", len(table)),
            fact("emulated_rows", emulated, count(emulated) if emulated else ""),
        ),
        tables=(visibility_table(table), *_measured(table)),
        contradictions=table.contradictions,
        files=(file,),
    )


def visibility_table(table: ObservationTable) -> Table:
    """Return how many features were measured, and why the others were not."""
    return Table.of(
        "visibility",
        (
            {"visibility": reason, "rows": rows, "share": rows / len(table)}
            for reason, rows in table.counts().items()
        ),
        (
            Column(name="visibility", label="features are"),
            Column(name="rows"),
            Column(name="share", label="share %", scale=100, decimals=1),
        ),
    )


def _source(campaign: Path | None, single: SingleCapture) -> cell.CaptureSource:
    """Return what is to be observed: a campaign's folder, or else a single capture."""
    if campaign is None:
        return single.source()
    if given := single.options():
        msg = f"give a campaign's folder or a single capture, not both (got {', '.join(given)})"
        raise UsageError(msg)
    if campaign.is_file() and campaign.suffix.lower() in {".csv", ".parquet"}:
        msg = f"{campaign}: a table; expected a campaign's folder, which has a campaign.json"
        raise FormatError(msg)
    return cell.CampaignFolder(campaign)


def _measured(table: ObservationTable) -> list[Table]:
    """Return the range of each column over the measured rows, and a few rows one by one."""
    measured = table.measured()
    if len(measured) == 0:
        return []
    low, middle, high = np.nanpercentile(measured.array(_RANGES), [0, 50, 100], axis=0)
    ranges = Table.of(
        "ranges",
        (
            {"column": name, "min": low[i], "median": middle[i], "max": high[i]}
            for i, name in enumerate(_RANGES)
        ),
        (
            Column(name="column", label="measured"),
            *(Column(name=name) for name in ("min", "median", "max")),
        ),
    )
    if len(table) > _FEW_ROWS:
        return [ranges]
    columns = (
        Column(name="feature"),
        Column(name="exposure_ms", digits=4),
        Column(name="p_norm", digits=3),
        Column(name="i_avg", label="i_avg\n0–255", digits=3),
        *(Column(name=f"{axis}_mm", label=f"{axis}\nmm") for axis in "xyz"),
        Column(name="w_deg", label="w\n°", digits=3),
        Column(name="p_deg", label="p\n°", digits=3),
        Column(name="visibility", wraps=True),
    )
    return [ranges, Table(name="observations", frame=table.frame, columns=columns)]

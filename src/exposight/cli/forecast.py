"""``exposight forecast``: the quality of every feature that a pose sees, over exposure time."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import polars as pl
from cyclopts import Group, Parameter
from cyclopts.validators import Number

from exposight.cell import ActiveSensor, MemoryCampaign, Part, read_features, sensor_named_or_read
from exposight.cli.app import UsageError
from exposight.cli.picture_files import check_picture, write_picture
from exposight.cli.pose import PoseOptions
from exposight.cli.result import Result, Written, fact
from exposight.contradictions import settle
from exposight.errors import InputError, did_you_mean
from exposight.files import spelled
from exposight.geometry import RigidTransform
from exposight.models import P_NORM_MIN
from exposight.observing import (
    Campaign,
    ObservationTable,
    View,
    n_visible,
    observe_campaign,
    open_campaign,
    pose_contradictions,
    read_observations,
    view_features,
    why_not_visible,
)
from exposight.planning import LIKELY, Forecast, SensorModels
from exposight.tables import Column, Table, number

_FEW_TIMES = 8
"""So many exposure times are shown on a terminal."""


@Parameter("*", group=Group("The view", sort_key=2))
@dataclass(frozen=True, kw_only=True)
class ViewOptions(PoseOptions):
    """What is seen, by which sensor, from where.

    Parameters
    ----------
    campaign
        Campaign whose sensor and part are meant.
    view
        Name of one of the campaign's views, in place of a pose.
    sensor
        Or the sensor: a preset's name or a JSON file.
    features
        And the part's features, CSV (docs/formats.md).
    """

    campaign: Path | None = None
    view: str | None = None
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None
    features: Path | None = None

    def seen(self) -> View:
        """Return the features and how the view sees them.

        Raises
        ------
        UsageError
            If options are missing or contradict each other.
        ExposightError
            If a file cannot be used, there is no such view, or it sees no feature.
        """
        view = self._view()
        if not view.visible:
            reasons = {feature.visibility.value for feature in view.features}
            msg = f"no feature is visible from this pose: {', '.join(sorted(reasons))}"
            raise InputError(msg)
        return view

    def _pose(self, part: Part, sensor: ActiveSensor) -> RigidTransform:
        """Return a pose that puts the part where the sensor sees and measures it.

        Raises
        ------
        ContradictionError
            If it is out of the sensor's reach, and another reading of the pose is not.
        InputError
            If no feature is visible; the message names the readings that would make some so.
        """
        pose = self.camera_from_part_seen(part, sensor)
        views = view_features(part, sensor, pose)
        hint = "" if n_visible(part, sensor, pose) else why_not_visible(part, sensor, pose)
        if hint:
            reasons = sorted({view.visibility.value for view in views})
            msg = f"no feature is visible from this pose: {', '.join(reasons)}; {hint}"
            raise InputError(msg)
        settle(pose_contradictions(views, part, sensor, pose))
        return pose

    def _view(self) -> View:
        if self.campaign is not None and self.sensor is None and self.features is None:
            campaign = open_campaign(self.campaign)
            if self.view is None:
                return campaign.view(self._pose(campaign.part, campaign.sensor))
            if self.has_pose:
                msg = "give a --view of the campaign or a pose, not both"
                raise UsageError(msg)
            return _view_named(campaign, self.view)
        if self.campaign is not None or self.sensor is None or self.features is None:
            msg = "give either --campaign, or both --sensor and --features"
            raise UsageError(msg)
        if self.view is not None:
            msg = "--view names a view of a --campaign; without one give a pose, such as --pose"
            raise UsageError(msg)
        part = Part(name=spelled(self.features.stem), features=read_features(self.features))
        sensor = sensor_named_or_read(self.sensor)
        view = View.of(part, sensor, self._pose(part, sensor))
        # such a file does not tell the part's name, by which models know its features
        return replace(view, shared={**view.shared, "part": None})


_NO_VIEW = ViewOptions()


def forecast_command(
    *models: Path,
    exposures_ms: Annotated[
        tuple[float, ...] | None, Parameter("--exposures", metavar="MS...", consume_multiple=True)
    ] = None,
    need: Annotated[float, Parameter(validator=Number(gt=0, lte=1))] = P_NORM_MIN,
    trial: Annotated[Path | None, Parameter(metavar="TABLE|CAMPAIGN")] = None,
    csv: Annotated[Path | None, Parameter(alias="-o")] = None,
    picture: Path | None = None,
    options: ViewOptions = _NO_VIEW,
) -> Result:
    r"""Forecast the quality of every visible feature over exposure time.

    Says of each feature that the sensor sees from a pose, before anything is captured there, which
    p_norm to expect, in a 2σ band, with which chance it reaches what is needed, and which exposure
    time serves most features. Features that the models do not know are named with the reason. One
    image or capture of the view, taken at any exposure time, makes the forecast of the default
    models surer.

    For example:

        exposight forecast models/ --campaign door --view middle-x1-y1

        exposight forecast models/ --campaign door --view middle-x1-y1 --trial one-capture.csv

        exposight forecast models/ --sensor sensor.json --features features.csv \
          --robot-pose fanuc 12.5,-3,600,0,0,90 --exposures 5 10 20 --csv forecast.csv

    Parameters
    ----------
    models
        quality.exposight-model, two model files, one for quality and one for exposure time, or the
        folder that holds them.
    exposures_ms
        Exposure times, ms; settings of the sensor from too short to too long by default.
    need
        Quality that is asked for, p_norm.
    trial
        Observations of this view, .csv or .parquet, or a campaign with captures of it.
    csv
        Write a row for each feature and exposure time to this CSV file.
    picture
        Draw p_norm and its band over exposure time, a panel for each feature: .png or .svg.
    """
    sensor_models = SensorModels.load(*models)
    if picture is not None:
        check_picture(picture)
    files = tuple(
        Written.at(path, kind, inputs=(*models, trial))
        for path, kind in ((csv, "forecast"), (picture, "picture"))
        if path is not None
    )
    view = options.seen()
    observed = None if trial is None else read_trial(trial, view.name)
    forecast = sensor_models.forecast(view, exposures_ms, trial=observed, need=need)
    if csv is not None:
        forecast.write(csv)
    if picture is not None:
        from exposight.report import forecast_picture  # takes seconds to import

        write_picture(picture, forecast_picture(forecast))
    best_ms, times = forecast.best_exposure_ms(), forecast.exposures_ms
    hidden = [seen.feature.name for seen in view.features if seen not in view.visible]
    notes = [f"not visible: {', '.join(hidden)}"] if hidden else []
    sources = ", ".join(dict.fromkeys(forecast.source))
    return Result(
        title=f"Forecast by {sensor_models.quality.name} and {sensor_models.exposure.name}",
        facts=(
            fact("best_exposure_ms", best_ms, f"{number(best_ms)}, {forecast.verdict}"),
            fact("visible_features", len(forecast.features)),
            fact("need", need, ""),
            fact(
                "exposures_ms", times, f"{len(times)}, {number(min(times))} to {number(max(times))}"
            ),
            fact("rests_on", forecast.source, sources),
        ),
        tables=(
            replace(forecast.table, title="The features at that exposure time"),
            _over_time(forecast),
            Table(name="forecast", frame=forecast.frame, columns=(), shown_rows=0),
        ),
        notes=(*notes, *forecast.notes),
        contradictions=() if observed is None else observed.contradictions,
        files=files,
    )


def read_trial(path: Path, view: str) -> ObservationTable:
    """Return what a table or a campaign shows; of a campaign that view alone, if it has a name."""
    if not (path / "campaign.json").is_file():
        return read_observations(path)
    campaign = open_campaign(path)
    if not view:
        return campaign.observe()
    keys = zip(campaign.numbers, campaign.keys(), strict=True)
    captures = [campaign.capture(number) for number, key in keys if key.view == view]
    return observe_campaign(
        MemoryCampaign(
            name=campaign.name, sensor=campaign.sensor, part=campaign.part, captures=captures
        )
    )


def _view_named(campaign: Campaign, name: str) -> View:
    """Return a view that a campaign was measured from."""
    names = []
    for capture in campaign.captures():
        if capture.view == name:
            return campaign.view(capture.camera_from_part, name)
        names.append(capture.view)
    msg = f"{campaign.name}: no view '{name}'{did_you_mean(name, names)}"
    raise InputError(msg)


def _over_time(forecast: Forecast) -> Table:
    """Return how all features together fare at some of the exposure times."""
    times = forecast.exposures_ms
    some = times[:: max(1, -(-len(times) // _FEW_TIMES))]
    frame = (
        forecast.frame.filter(pl.col("exposure_ms").is_in(some))
        .group_by("exposure_ms", maintain_order=True)
        .agg(
            pl.col("p_norm").mean().alias("mean_p_norm"),
            pl.col("p_norm").min().alias("least_p_norm"),
            (pl.col("chance") >= LIKELY).sum().alias("likely_features"),
            pl.col("chance").sum().alias("expected_features"),
        )
    )
    columns = (
        Column(name="exposure_ms", digits=4),
        Column(name="mean_p_norm", label="mean\np_norm", decimals=2),
        Column(name="least_p_norm", label="least\np_norm", decimals=2),
        Column(
            name="likely_features", label=f"features with a chance\nof {100 * LIKELY:g} % or more"
        ),
        Column(name="expected_features", label="expected\nnumber", decimals=1),
    )
    title = f"All features together; how many reach {forecast.need:g}"
    return Table(name="over_time", frame=frame, columns=columns, title=title)

"""The study's campaigns: simulated by a plan, or recorded; observed once and kept.

A folder of recorded campaigns holds, under the names of `CAMPAIGNS`, campaign folders
(``docs/formats.md``) or tables of their observations: ``inside`` or ``inside.parquet`` or
``inside.csv``, and so on. Features must have the paper's names, ``f1`` … ``f9``, ``f1_test`` …
``f4_test``, ``f1_out`` … ``f5_out``. Only ``inside`` (and ``stereo-inside`` where the stereo sensor
is asked for) must be there; what depends on the others is left out of the tables.
"""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from exposight import __version__
from exposight.cell import ActiveSensor, CampaignFolder, sensor_preset
from exposight.errors import FeatureError, MissingFileError, ObservationError, SensorError
from exposight.files import KeptFiles, sha256_of
from exposight.measuring import measure_observations
from exposight.observing import ObservationTable, observe_campaign, read_observations
from exposight.paper.datasets import DATASETS, TEST, TRAINING
from exposight.paper.study_settings import SensorKind, StudySettings
from exposight.plans import MeasuringPlan, plan_preset, plan_to_toml
from exposight.twin import SimulatedCell, scene_at, scene_checksum
from exposight.workers import Progress

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class StudyCampaign:
    """A campaign that the study needs.

    Parameters
    ----------
    name : str
        Name in the study, and of a recording in a folder of campaigns.
    sensor : {'structured-light', 'stereo'}
        Sensor that measures it.
    required : bool
        Whether a study of this sensor needs it.
    """

    name: str
    sensor: SensorKind
    required: bool = False

    def features(self) -> tuple[str, ...]:
        """Return the features that the datasets take from it."""
        datasets = (dataset for dataset in DATASETS if self.name in dataset.campaigns)
        return tuple(dict.fromkeys(name for dataset in datasets for name in dataset.features))


CAMPAIGNS: Final = (
    StudyCampaign(name="inside", sensor="structured-light", required=True),
    StudyCampaign(name="finer", sensor="structured-light"),
    StudyCampaign(name="lighting-1", sensor="structured-light"),
    StudyCampaign(name="lighting-2", sensor="structured-light"),
    StudyCampaign(name="lighting-3", sensor="structured-light"),
    StudyCampaign(name="outside", sensor="structured-light"),
    StudyCampaign(name="stereo-inside", sensor="stereo", required=True),
    StudyCampaign(name="stereo-outside", sensor="stereo"),
)
"""All campaigns, in the order in which they are measured."""


def campaign_plan(campaign: StudyCampaign, *, quick: bool) -> MeasuringPlan:
    """Return the measuring plan by which a campaign is simulated.

    Parameters
    ----------
    campaign : StudyCampaign
        Which one.
    quick : bool
        Measure a share of the positions and exposure times: of ``finer`` every second x and y (9 of
        25 views), of ``stereo-inside`` every third x and y (30 of 240 views), of ``stereo-outside``
        three of six views, which together see all five features; of both every third exposure
        time. The other campaigns are measured in full.
    """
    plan = _full_plan(campaign.name)
    if not quick:
        return plan
    match campaign.name:
        case "finer":
            return _thinned(plan, x=slice(0, None, 2), y=slice(0, None, 2), exposures=slice(None))
        case "stereo-inside":
            return _thinned(plan, x=_THIRD, y=_THIRD, exposures=_THIRD_EXPOSURE)
        case "stereo-outside":
            (positions,) = plan.random
            exposures_ms = positions.exposures_ms[_THIRD_EXPOSURE]
            return replace(plan, random=(replace(positions, count=3, exposures_ms=exposures_ms),))
    return plan


_THIRD = slice(1, None, 3)
"""Of eight x the second, fifth and eighth; of six y the second and fifth."""

_THIRD_EXPOSURE = slice(2, None, 3)
"""Of the stereo sensor's sixteen: in nine of ten places where a feature reaches p_norm 0.75, it
does so at three or more of them in a row, so that such a place keeps a row."""


def _full_plan(name: str) -> MeasuringPlan:
    match name:
        case "finer":  # eX⁺⁺ less what `inside` has already
            plan = plan_preset("ex-plusplus")
            return replace(plan, name=name, planes=plan.planes[-1:])
        case "outside":
            return replace(plan_preset("x-out"), name=name)
        case "stereo-inside":  # X and X test see the same views
            return replace(plan_preset("stereo-x"), name=name, features=TRAINING + TEST)
        case "stereo-outside":
            return replace(plan_preset("stereo-x-out"), name=name)
    return plan_preset(name)


def _thinned(plan: MeasuringPlan, *, x: slice, y: slice, exposures: slice) -> MeasuringPlan:
    planes = (
        replace(
            plane,
            x_mm=plane.x_mm[x],
            y_mm=plane.y_mm[y],
            exposures_ms=plane.exposures_ms[exposures],
        )
        for plane in plan.planes
    )
    return replace(plan, planes=tuple(planes))


def plan_size(plan: MeasuringPlan) -> tuple[int, int]:
    """Return how many views and captures a plan has."""
    return (
        sum(group.n_views for group in plan.groups),
        plan.n_captures,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedCampaign:
    """A campaign's observations.

    Parameters
    ----------
    campaign : StudyCampaign
        Which one.
    sensor : ActiveSensor
        Sensor that measured it.
    table : ObservationTable
        A row for each feature and capture.
    description : str
        One line: views, captures, simulated or recorded.
    """

    campaign: StudyCampaign
    sensor: ActiveSensor
    table: ObservationTable
    description: str


def collect(
    campaign: StudyCampaign,
    folder: Path,
    settings: StudySettings,
    progress: Progress,
) -> ObservedCampaign | None:
    """Simulate a campaign, or read a recorded one; resume an interrupted run.

    Parameters
    ----------
    campaign : StudyCampaign
        Which one.
    folder : Path
        Where observations are kept, each under a name that has a checksum of what decides it; it
        must exist. A table that is complete is used again.
    settings : StudySettings
        Recorded or simulated, quick or in full, by how many workers.
    progress : Progress
        Receives the captures that are measured.

    Returns
    -------
    ObservedCampaign or None
        None where an optional recorded campaign is missing.

    Raises
    ------
    MissingFileError
        If a required recorded campaign is missing.
    FeatureError
        If a recorded campaign lacks features that the study needs.
    SensorError
        If a recorded campaign is of the wrong kind of sensor.
    ExposightError
        As for `measure_observations` and `observe_campaign`.
    """
    if settings.campaigns is None:
        return _simulated(campaign, folder, settings, progress)
    return _recorded(campaign, folder, settings.campaigns, progress)


def _simulated(
    campaign: StudyCampaign,
    folder: Path,
    settings: StudySettings,
    progress: Progress,
) -> ObservedCampaign:
    plan = campaign_plan(campaign, quick=settings.quick)
    kept = KeptFiles(folder, plan_to_toml(plan), scene_checksum(scene_at(None)), __version__)
    name = f"{campaign.name}.parquet"
    if kept.find(name) is None:
        stage = f"measuring {campaign.name}"
        measure_observations(
            plan,
            SimulatedCell.for_plan(plan, rings_only=campaign.sensor != "stereo"),
            table_path=kept.path(name),
            workers=settings.workers,
            progress=lambda _, done, total: progress(stage, done, total),
        )
        kept.seal(name)
    table = read_observations(kept.path(name))
    return ObservedCampaign(
        campaign=campaign,
        sensor=plan.sensor,
        table=table,
        description=_described(campaign, plan),
    )


def _extent(views: int, captures: int) -> str:
    return f"{views} view{'s' * (views != 1)}, {captures} captures"


def _described(campaign: StudyCampaign, plan: MeasuringPlan) -> str:
    size, whole = plan_size(plan), plan_size(campaign_plan(campaign, quick=False))
    share = (
        f"; the full study has {whole[0]} views and {whole[1]} captures" if size != whole else ""
    )
    return f"{campaign.name}: {_extent(*size)}, simulated{share}"


def _recorded(
    campaign: StudyCampaign, folder: Path, campaigns: Path, progress: Progress
) -> ObservedCampaign | None:
    source = _recording(campaign, campaigns)
    if source is None:
        return None
    if source.is_dir():
        sensor, table = _observed(source, folder, campaign, progress)
    else:
        table = read_observations(source)
        preset = "rc-visard-65" if campaign.sensor == "stereo" else "comet-pro-ae"
        sensor = sensor_preset(preset)  # a table does not say by what it was measured
    known = set(table.names("feature"))
    missing = [name for name in campaign.features() if name not in known]
    if missing:
        msg = (
            f"{source}: the campaign lacks the features {', '.join(missing)}; the study needs "
            f"{', '.join(campaign.features())} there, and it has {', '.join(sorted(known))}; "
            "name the features as the paper does"
        )
        raise FeatureError(msg)
    if len(table.measured()) == 0:
        msg = f"{source}: none of its {len(table)} rows was measured; nothing can be learnt from it"
        raise ObservationError(msg)
    views = len(set(table.names("view")))
    captures = table.frame.select("view", "exposure_ms").n_unique()
    return ObservedCampaign(
        campaign=campaign,
        sensor=sensor,
        table=table,
        description=f"{campaign.name}: {_extent(views, captures)}, recorded",
    )


def _recording(campaign: StudyCampaign, campaigns: Path) -> Path | None:
    names = (campaign.name, f"{campaign.name}.parquet", f"{campaign.name}.csv")
    for path in (campaigns / name for name in names):
        if path.exists():
            return path
    if not campaign.required:
        _logger.info("no campaign %s in %s: left out", campaign.name, campaigns)
        return None
    present = sorted(entry.name for entry in campaigns.iterdir()) if campaigns.is_dir() else []
    msg = (
        f"{campaigns}: expected a campaign folder '{campaign.name}' or a table "
        f"'{campaign.name}.parquet' or .csv, found {', '.join(present) or 'nothing'}; all names "
        f"are {', '.join(known.name for known in CAMPAIGNS)}"
    )
    raise MissingFileError(msg)


def _observed(
    source: Path, folder: Path, campaign: StudyCampaign, progress: Progress
) -> tuple[ActiveSensor, ObservationTable]:
    recording = CampaignFolder(source)
    if (len(recording.sensor.cameras) > 1) != (campaign.sensor == "stereo"):
        msg = (
            f"{source}: expected a campaign of a {campaign.sensor} sensor, got one of "
            f"{recording.sensor.name!r} with {len(recording.sensor.cameras)} cameras"
        )
        raise SensorError(msg)
    # Documents carry the checksums of all other files.
    documents = sorted(path for path in source.rglob("*.json") if path.is_file())
    kept = KeptFiles(folder, *(sha256_of(path.read_bytes()) for path in documents), __version__)
    name = f"{campaign.name}.parquet"
    if kept.find(name) is None:
        stage = f"measuring {campaign.name}"
        table = observe_campaign(
            recording, progress=lambda _, done, total: progress(stage, done, total)
        )
        table.write(kept.path(name))
        kept.seal(name)
    return recording.sensor, read_observations(kept.path(name))

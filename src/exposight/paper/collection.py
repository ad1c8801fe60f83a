"""The study's campaigns: simulated, or recorded by somebody; observed once and kept.

A folder of recorded campaigns holds, under the names of `CAMPAIGNS`, campaign folders
(``docs/formats.md``) or tables of their observations: ``inside`` or ``inside.parquet`` or
``inside.csv``, and so on. Features must have the paper's names, ``f1`` … ``f9``, ``f1_test`` …
``f4_test``, ``f1_out`` … ``f5_out``. Only ``inside`` (and ``stereo-inside`` where the stereo sensor
is asked for) must be there; what depends on the others is left out of the tables.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from exposight import __version__
from exposight.cell import ActiveSensor, CampaignFolder, sensor_preset
from exposight.errors import FeatureError, MissingFileError, ObservationError, SensorError
from exposight.files.documents import sha256_of
from exposight.observing import ObservationTable, observe_campaign, read_observations
from exposight.paper.campaigns import CAMPAIGNS, campaign_plan, plan_size
from exposight.paper.kept_tables import kept_table, seal_table, table_path
from exposight.plans import plan_to_toml
from exposight.twin.campaign import CellSettings, scene_at, scene_checksum, simulate_observations

if TYPE_CHECKING:
    from collections.abc import Callable

    from exposight.paper.campaigns import Campaign
    from exposight.paper.result import StudySettings
    from exposight.plans import MeasuringPlan


_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservedCampaign:
    """A campaign's observations.

    Parameters
    ----------
    campaign : Campaign
        Which one.
    sensor : ActiveSensor
        That measured.
    table : ObservationTable
        A row for each feature and capture.
    description : str
        What was measured, in a line.
    """

    campaign: Campaign
    sensor: ActiveSensor
    table: ObservationTable
    description: str


def collect(
    campaign: Campaign,
    folder: Path,
    settings: StudySettings,
    progress: Callable[[int, int], None],
) -> ObservedCampaign | None:
    """Measure a campaign, or read somebody's; go on where an earlier run stopped.

    Parameters
    ----------
    campaign : Campaign
        Which one.
    folder : Path
        Where observations are kept, each under a name that has a checksum of what decides it; it
        must exist. A table that is there and whole is used again.
    settings : StudySettings
        Recorded or simulated, quick or in full, by how many workers.
    progress : callable
        Called with (captures done, captures in all).

    Returns
    -------
    ObservedCampaign or None
        None where a recorded campaign is not there and not required.

    Raises
    ------
    MissingFileError
        If a required recorded campaign is not there.
    FeatureError
        If a recorded campaign lacks features that the study needs.
    SensorError
        If a recorded campaign is of the wrong kind of sensor.
    ExposightError
        As for `simulate_observations` and `observe_campaign`.
    """
    if settings.campaigns is None:
        return _simulated(campaign, folder, settings, progress)
    return _recorded(campaign, folder, settings.campaigns, progress)


def _simulated(
    campaign: Campaign,
    folder: Path,
    settings: StudySettings,
    progress: Callable[[int, int], None],
) -> ObservedCampaign:
    plan = campaign_plan(campaign, quick=settings.quick)
    decisive = (plan_to_toml(plan), scene_checksum(scene_at(None)), __version__)
    path = table_path(folder, campaign.name, decisive)
    table = kept_table(path)
    if table is None:
        cell = CellSettings(rings_only=campaign.sensor != "stereo", workers=settings.workers)
        table = simulate_observations(plan, cell, progress, table_path=path)
        seal_table(path)
    return ObservedCampaign(
        campaign=campaign,
        sensor=sensor_preset(plan.sensor),
        table=table,
        description=_described(campaign, plan),
    )


def _extent(views: int, captures: int) -> str:
    return f"{views} view{'s' * (views != 1)}, {captures} captures"


def _described(campaign: Campaign, plan: MeasuringPlan) -> str:
    size, whole = plan_size(plan), plan_size(campaign_plan(campaign, quick=False))
    share = (
        f"; the full study has {whole[0]} views and {whole[1]} captures" if size != whole else ""
    )
    return f"{campaign.name}: {_extent(*size)}, simulated{share}"


def _recorded(
    campaign: Campaign, folder: Path, campaigns: Path, progress: Callable[[int, int], None]
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


def _recording(campaign: Campaign, campaigns: Path) -> Path | None:
    names = (campaign.name, f"{campaign.name}.parquet", f"{campaign.name}.csv")
    for path in (campaigns / name for name in names):
        if path.exists():
            return path
    if not campaign.required:
        _logger.info("no campaign %s in %s: left out", campaign.name, campaigns)
        return None
    there = sorted(entry.name for entry in campaigns.iterdir()) if campaigns.is_dir() else []
    msg = (
        f"{campaigns}: expected a campaign folder '{campaign.name}' or a table "
        f"'{campaign.name}.parquet' or .csv, found {', '.join(there) or 'nothing'}; all names are "
        f"{', '.join(own.name for own in CAMPAIGNS)}"
    )
    raise MissingFileError(msg)


def _observed(
    source: Path, folder: Path, campaign: Campaign, progress: Callable[[int, int], None]
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
    decisive = (*(sha256_of(path.read_bytes()) for path in documents), __version__)
    path = table_path(folder, campaign.name, decisive)
    table = kept_table(path)
    if table is None:
        table = observe_campaign(recording, progress=progress)
        table.write(path)
        seal_table(path)
    return recording.sensor, table

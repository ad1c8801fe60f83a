"""``exposight merge``: captures of a view at several exposure times merged into one."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import polars as pl
from cyclopts import Parameter

from exposight.cell import CampaignWriter, Capture
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.errors import FileError, InputError, did_you_mean
from exposight.files import durable_folder, make_folder
from exposight.imaging import merge_captures, merge_record
from exposight.models import WindowModel
from exposight.observing import Campaign, Observation, ObservationTable, Observer, open_campaign
from exposight.planning import SensorModels
from exposight.planning.merged_quality import MergeGain, merged_p_norm
from exposight.tables import Column, Table, counted, number

_COLUMNS = (
    Column(name="view"),
    Column(name="exposures_ms", wraps=True),
    Column(name="points"),
    Column(name="criterion", label="chosen by"),
)


def merge_command(
    campaign: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o", metavar="FOLDER")],
    view: Annotated[tuple[str, ...], Parameter(metavar="NAME...", consume_multiple=True)] = (),
    exposures_ms: Annotated[
        tuple[float, ...], Parameter("--exposures", metavar="MS...", consume_multiple=True)
    ] = (),
    models: Path | None = None,
) -> Result:
    r"""Merge captures of a view at several exposure times into one (HDR).

    Each pixel's point is that of the exposure in which the pixel is modulated most without clipping
    (Zhang & Yau 2009); without stack images, in which it is brightest. Nothing is averaged. What
    was gained is told against the best single capture of each feature; where that is nothing, it
    says so.

    For example:

        exposight merge door -o door-merged

        exposight merge door --view near-x1-y1 --exposures 5 40 --models models -o merged

    Parameters
    ----------
    campaign
        A campaign's folder, with organised clouds.
    output
        Folder for the campaign of merged captures, one for each view.
    view
        Views to merge; all by default. Those with a single capture are kept as they are.
    exposures_ms
        Merge captures of these exposure times only, ms.
    models
        Default models: what they promise of the merged captures is told beside.
    """
    recorded = open_campaign(campaign)
    views = _captures_of_views(recorded, view, exposures_ms)
    if output.exists():
        msg = f"{output} is there already; give another --output for the merged captures"
        raise FileError(msg)
    model = None if models is None else _window_model(models)
    observer = Observer(recorded.part, recorded.sensor)
    rows: list[dict[str, object]] = []
    single, merged = [], []
    promised: list[pl.DataFrame] = []
    make_folder(output.parent)
    with (
        durable_folder(output) as folder,
        progress_bars() as progress,
        CampaignWriter.open_or_create(
            folder, name=f"{recorded.name}, merged", sensor=recorded.sensor, part=recorded.part
        ) as writer,
    ):
        for done, (name, numbers) in enumerate(views.items()):
            progress("merging", done, len(views))
            captures = _Stored(recorded, numbers)
            capture = merge_captures(captures)
            writer.add(capture)
            record = merge_record(capture)
            if record is None:
                continue
            rows.append({"view": name, **vars(record)})
            for each in captures:
                single += observer.observe(each)
            seen = observer.observe(capture)
            merged += seen
            if model is not None:
                promised += _promised(model, seen, record.exposures_ms)
        progress("merging", len(views), len(views))
    gain = MergeGain.of(
        ObservationTable.from_observations(single),
        ObservationTable.from_observations(merged),
        pl.concat(promised) if promised else None,
    )
    alone = len(views) - len(rows)
    return Result(
        title=gain.verdict,
        facts=(
            fact("campaign", recorded.name, ""),
            fact("views", len(rows), f"{counted(len(rows), 'view')} merged"),
            fact("mean_gain", gain.frame["gain"].mean(), ""),
        ),
        tables=(
            Table.of("merged", rows, _COLUMNS),
            gain.table,
            Table(name="features", frame=gain.frame, columns=(), shown_rows=0),
        ),
        notes=(f"{counted(alone, 'view')} of a single capture kept as it is",) if alone else (),
        contradictions=observer.contradictions,
        files=(Written(kind="campaign", path=output, replaced=False),),
    )


class _Stored(Sequence[Capture]):
    """Captures of a campaign, each read when it is looked up."""

    def __init__(self, campaign: Campaign, numbers: Sequence[int]) -> None:
        self._campaign, self._numbers = campaign, numbers

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, place: Any) -> Any:
        return self._campaign.capture(self._numbers[place])


def _captures_of_views(
    campaign: Campaign, names: Sequence[str], exposures_ms: Sequence[float]
) -> dict[str, list[int]]:
    """Return the numbers of the captures to merge, view by view.

    Raises
    ------
    InputError
        If there is no such view, or none has several captures.
    """
    views: dict[str, list[int]] = {}
    for place, each in zip(campaign.numbers, campaign.descriptions(), strict=True):
        if not exposures_ms or each.exposure_ms in exposures_ms:
            views.setdefault(each.view, []).append(place)
    for name in names:
        if name not in views:
            msg = f"campaign {campaign.name!r} has no such capture of a view {name!r}"
            raise InputError(msg + did_you_mean(name, views))
    if names:
        views = {name: views[name] for name in dict.fromkeys(names)}
    if max(map(len, views.values()), default=0) < 2:
        given = f" at {', '.join(map(number, exposures_ms))} ms" if exposures_ms else ""
        msg = f"nothing to merge: no view of campaign {campaign.name!r} has several captures{given}"
        raise InputError(msg)
    return views


def _window_model(path: Path) -> WindowModel:
    model = SensorModels.load(path).quality
    if isinstance(model, WindowModel):
        return model
    msg = f"{path}: only the default models promise what merging gives, got {model.name}"
    raise InputError(msg)


def _promised(
    model: WindowModel, rows: Sequence[Observation], exposures_ms: Sequence[float]
) -> list[pl.DataFrame]:
    """Return what a model promises of a view's merged rings; nothing where none is visible."""
    rings = ObservationTable.from_observations(rows).measured().frame
    if rings.height == 0:
        return []
    expected = merged_p_norm(model.forecast(rings, exposures_ms), exposures_ms)
    return [rings.select("feature", "view").with_columns(promised=pl.Series(expected))]

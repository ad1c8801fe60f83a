"""What the study measures: campaigns and their plans, in full and quickly."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import polars as pl
import pytest

from exposight.cell import CampaignWriter, sensor_preset
from exposight.errors import (
    FeatureError,
    FormatError,
    MissingFileError,
    ObservationError,
    SensorError,
)
from exposight.observing import ObservationTable
from exposight.paper import StudySettings
from exposight.paper import campaigns as campaigns_module
from exposight.paper.campaigns import CAMPAIGNS, StudyCampaign, campaign_plan, collect, plan_size
from exposight.twin.part import door
from exposight.workers import ignore_progress


@pytest.mark.parametrize(
    ("name", "views", "captures"),
    [
        ("inside", 48, 480),
        ("finer", 25, 600),
        ("lighting-2", 1, 5),
        ("outside", 14, 70),
        ("stereo-inside", 240, 3840),
        ("stereo-outside", 6, 96),
    ],
)
def test_full_campaigns_have_the_plans_views(name: str, views: int, captures: int) -> None:
    (campaign,) = (campaign for campaign in CAMPAIGNS if campaign.name == name)
    plan = campaign_plan(campaign, quick=False)
    assert plan_size(plan) == (views, captures)


@pytest.mark.parametrize("campaign", CAMPAIGNS, ids=lambda campaign: campaign.name)
@pytest.mark.parametrize("quick", [True, False])
def test_plans_observe_what_the_datasets_need(campaign: StudyCampaign, quick: bool) -> None:
    assert set(campaign.features()) <= set(campaign_plan(campaign, quick=quick).features)


def test_a_quick_study_has_all_depths_of_the_full_one() -> None:
    (stereo,) = (campaign for campaign in CAMPAIGNS if campaign.name == "stereo-inside")
    quick, full = (campaign_plan(stereo, quick=quick) for quick in (True, False))
    assert [plane.z_tcp_mm for plane in quick.planes] == [plane.z_tcp_mm for plane in full.planes]


INSIDE, *_, LIGHTING, OUTSIDE, STEREO, _ = CAMPAIGNS


@pytest.fixture
def simulations(
    monkeypatch: pytest.MonkeyPatch, observe: Callable[..., ObservationTable]
) -> list[str]:
    """Replace the simulated cell by one on paper; return what it was asked to measure."""
    asked: list[str] = []

    def simulate(
        plan: object, cell: object, *, table_path: Path, workers: int, progress: object
    ) -> ObservationTable:
        asked.append(plan.name)
        table = observe(["f1_test", "f2_test", "f3_test"], views=1)
        table.write(table_path)
        return table

    cell = SimpleNamespace(for_plan=lambda *_, **__: None)
    monkeypatch.setattr(campaigns_module, "SimulatedCell", cell)
    monkeypatch.setattr(campaigns_module, "measure_observations", simulate)
    return asked


def test_what_was_measured_is_not_measured_again(simulations: list[str], tmp_path: Path) -> None:
    first = collect(LIGHTING, tmp_path, StudySettings(), ignore_progress)
    again = collect(LIGHTING, tmp_path, StudySettings(), ignore_progress)
    assert simulations == ["lighting-3"]
    assert first.table.frame.equals(again.table.frame)


def test_workers_do_not_matter(simulations: list[str], tmp_path: Path) -> None:
    for workers in (1, 2):
        collect(LIGHTING, tmp_path, StudySettings(workers=workers), ignore_progress)
    assert simulations == ["lighting-3"]


def test_another_plan_is_another_measurement(simulations: list[str], tmp_path: Path) -> None:
    for quick in (True, False):
        collect(STEREO, tmp_path, StudySettings(quick=quick), ignore_progress)
    assert simulations == ["stereo-inside", "stereo-inside"]


def test_another_version_measures_again(
    simulations: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    collect(LIGHTING, tmp_path, StudySettings(), ignore_progress)
    monkeypatch.setattr(campaigns_module, "__version__", "99")
    collect(LIGHTING, tmp_path, StudySettings(), ignore_progress)
    assert len(simulations) == 2


@pytest.mark.parametrize("byte", [0, 500, -1])
def test_a_damaged_table_is_measured_again(
    simulations: list[str], tmp_path: Path, byte: int, caplog: pytest.LogCaptureFixture
) -> None:
    whole = collect(LIGHTING, tmp_path, StudySettings(), ignore_progress).table
    (path,) = tmp_path.glob("*.parquet")
    content = bytearray(path.read_bytes())
    content[byte] ^= 0xFF
    path.write_bytes(content)
    again = collect(LIGHTING, tmp_path, StudySettings(), ignore_progress).table
    assert len(simulations) == 2
    assert again.frame.equals(whole.frame)
    assert "made again" in caplog.text


def test_a_table_whose_checksum_was_not_yet_written_is_measured_again(
    simulations: list[str], tmp_path: Path
) -> None:
    collect(LIGHTING, tmp_path, StudySettings(), ignore_progress)
    (seal,) = tmp_path.glob("*.sha256")
    seal.unlink()
    collect(LIGHTING, tmp_path, StudySettings(), ignore_progress)
    assert len(simulations) == 2
    assert seal.is_file()


def test_a_share_of_the_views_is_said(simulations: list[str], tmp_path: Path) -> None:
    found = collect(STEREO, tmp_path, StudySettings(quick=True), ignore_progress)
    assert found.description == (
        "stereo-inside: 30 views, 150 captures, simulated; the full study has 240 views and "
        "3840 captures"
    )


def test_recorded_tables_are_read(campaigns: Path, tmp_path: Path) -> None:
    found = collect(INSIDE, tmp_path, StudySettings(campaigns=campaigns), ignore_progress)
    assert found.description == "inside: 6 views, 30 captures, recorded"


def test_what_is_not_required_may_be_missing(campaigns: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert collect(OUTSIDE, tmp_path, StudySettings(campaigns=empty), ignore_progress) is None


@pytest.mark.parametrize("there", [[], ["door.csv"], None])
def test_a_missing_required_campaign_is_named(tmp_path: Path, there: list[str] | None) -> None:
    folder = tmp_path / "mine"
    if there is not None:
        folder.mkdir()
        for name in there:
            (folder / name).touch()
    found = ", ".join(there) if there else "nothing"
    with pytest.raises(MissingFileError, match=f"campaign folder 'inside' .* found {found}"):
        collect(INSIDE, tmp_path, StudySettings(campaigns=folder), ignore_progress)


def test_missing_features_are_named(
    observe: Callable[..., ObservationTable], tmp_path: Path
) -> None:
    observe(["f1", "f2", "hole"]).write(tmp_path / "inside.csv")
    with pytest.raises(FeatureError, match=r"lacks the features f3, f4, .* it has f1, f2, hole"):
        collect(INSIDE, tmp_path, StudySettings(campaigns=tmp_path), ignore_progress)


def test_a_campaign_without_a_measured_row_is_refused(
    observe: Callable[..., ObservationTable], tmp_path: Path
) -> None:
    frame = observe(INSIDE.features(), views=1).frame
    hidden = frame.with_columns(
        p_norm=pl.lit(None, pl.Float64),
        i_avg=pl.lit(None, pl.Float64),
        visibility=pl.lit("out of frame"),
    )
    ObservationTable(frame=hidden).write(tmp_path / "inside.csv")
    with pytest.raises(ObservationError, match="none of its 65 rows was measured"):
        collect(INSIDE, tmp_path, StudySettings(campaigns=tmp_path), ignore_progress)


def test_a_table_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "inside.csv").write_text("not,a,table\n1,2,3\n")
    with pytest.raises(FormatError, match=r"inside\.csv: missing columns"):
        collect(INSIDE, tmp_path, StudySettings(campaigns=tmp_path), ignore_progress)


def test_a_campaign_of_the_other_sensor_is_refused(tmp_path: Path) -> None:
    with CampaignWriter.open_or_create(
        tmp_path / "stereo-inside",
        name="mine",
        sensor=sensor_preset("comet-pro-ae"),
        part=door().part,
    ):
        pass
    with pytest.raises(SensorError, match="expected a campaign of a stereo sensor, got one of"):
        collect(STEREO, tmp_path, StudySettings(campaigns=tmp_path), ignore_progress)

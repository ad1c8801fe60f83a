"""A plan carried out capture by capture: what is asked for, read back, kept, and gone on with."""

import json
import shutil
from dataclasses import replace

import polars as pl
import pytest

from exposight.cell import CampaignFolder
from exposight.errors import ContradictionError, FeatureError, FileError, InputError, SensorError
from exposight.measuring import adaptive, measure_adaptively
from exposight.measuring.adaptive import CONTRADICTED_FOLDER
from exposight.measuring.decisions import DECISIONS_FILE, RESULT_FILE
from exposight.measuring.open_loop import OpenLoop
from exposight.measuring.record import EXPOSURE_PLAN_FILE
from exposight.observing import observe_campaign, read_observations
from exposight.planning.exposure_plan import read_exposure_plan

FOLLOWING = (DECISIONS_FILE, "outcomes.csv", RESULT_FILE, "observations.csv")
"""What follows from captures."""


@pytest.fixture
def loop(plate_plan, plate_driver, tmp_path):
    """Carry the plan out, without corrections."""

    def run(driver=None, folder="door", plan=plate_plan, **options):
        driver = driver or plate_driver()
        return measure_adaptively(plan, driver, tmp_path / folder, models=None, **options)

    return run


def test_captures_decisions_and_outcomes_are_written(loop, tmp_path, plate_plan):
    told, reports = [], []
    result = loop(tell=told.append, progress=lambda *report: reports.append(report))
    folder = tmp_path / "door"
    assert CampaignFolder(folder).keys() == (("near", 1.0), ("near", 10.0), ("far", 12.0))
    assert read_exposure_plan(folder / EXPOSURE_PLAN_FILE) == plate_plan
    assert told == list(result.decisions)
    assert [decision.succeeded for decision in told] == [("b1", "b2"), ("d1", "d2"), ()]
    lines = (folder / DECISIONS_FILE).read_text("utf-8").splitlines()
    assert json.loads(lines[1])["succeeded"] == ["d1", "d2"]
    assert str(told[1]) == "2. near, as planned: 10 ms → near, 10 ms: got d1, d2"
    assert result.succeeded == ("b1", "b2", "d1", "d2")
    assert pl.read_csv(folder / "outcomes.csv")["status"].to_list() == ["had"] * 4
    document = json.loads((folder / RESULT_FILE).read_text("utf-8"))
    assert (document["captures"], document["achieved"]) == (3, 4)
    assert (reports[0], reports[-1]) == (("measuring", 0, 4), ("measuring", 4, 4))
    whole = observe_campaign(CampaignFolder(folder)).frame
    assert read_observations(folder / "observations.csv").frame.equals(whole)


def test_a_feature_that_no_capture_serves_is_named_with_what_was_measured(loop, plate_driver):
    result = loop(plate_driver(light=0.1))
    assert result.succeeded == ("b1", "b2")
    assert result.failed == dict.fromkeys(("d1", "d2"), "it reached 0.00, 0.75 is needed")
    assert "2 of 4 features succeeded, 3.9 were promised; d1 failed because" in result.verdict


def test_a_pose_read_back_elsewhere_is_remarked_upon(loop, plate_driver):
    result = loop(plate_driver(shift_mm=30.0))
    assert all("30 mm elsewhere" in decision.remark for decision in result.decisions)
    assert result.succeeded == ("b1", "b2", "d1", "d2")
    assert not any(decision.remark for decision in loop(folder="near").decisions)


@pytest.mark.parametrize("kept", [0, 1, 2, 3])
def test_a_loop_goes_on_to_the_same_bytes(kept, loop, tmp_path, content, plate_driver):
    """As after a kill before a capture was whole, or between it and what follows from it."""
    loop(folder="whole")
    loop()
    for number in range(kept, 3):
        shutil.rmtree(tmp_path / "door" / "captures" / f"{number:06d}")
    for name in FOLLOWING:
        (tmp_path / "door" / name).unlink()
    driver = plate_driver()
    result = loop(driver)
    assert len(driver.taken) == 3 - kept
    assert len(result.decisions) == 3
    assert content(tmp_path / "door") == content(tmp_path / "whole")


def test_without_clouds_it_decides_the_same(loop, tmp_path, plate_driver):
    with_clouds, without = loop(folder="clouds"), loop(clouds=False)
    assert without.decisions == with_clouds.decisions
    assert all(capture.cloud is None for capture in CampaignFolder(tmp_path / "door").captures())
    driver = plate_driver()
    loop(driver, clouds=False)
    assert not driver.taken
    with pytest.raises(InputError, match="no clouds kept, not with them"):
        loop()


def test_a_driver_that_fails_costs_no_capture(loop, tmp_path, plate_driver, content):
    loop(folder="whole")
    driver = plate_driver(fail_at=2)
    with pytest.raises(SensorError, match=r"view 'far' at 12 ms: .*lost trigger.*run again"):
        loop(driver)
    assert len(CampaignFolder(tmp_path / "door")) == 2
    assert len((tmp_path / "door" / DECISIONS_FILE).read_bytes().splitlines()) == 2
    loop(driver)
    assert len(driver.taken) == 3
    assert content(tmp_path / "door") == content(tmp_path / "whole")


def test_exposure_times_are_those_read_back(loop, tmp_path, plate_driver):
    result = loop(plate_driver(read_back=lambda ms: ms + 0.5))
    assert [(d.asked_ms, d.exposure_ms) for d in result.decisions] == [
        (1.0, 1.5), (10.0, 10.5), (12.0, 12.5)
    ]  # fmt: skip
    rows = read_observations(tmp_path / "door" / "observations.csv").frame
    assert rows["exposure_ms"].unique(maintain_order=True).to_list() == [1.5, 10.5, 12.5]


def test_an_exposure_time_far_from_the_one_asked_for_is_an_error(loop, tmp_path, plate_driver):
    with pytest.raises(SensorError, match=r"set to 1 ms and took 3 ms.*increment of 0.5 ms"):
        loop(plate_driver(read_back=lambda ms: 3 * ms))
    assert len(CampaignFolder(tmp_path / "door")) == 0


def test_an_exposure_time_that_was_taken_before_is_an_error(
    loop, tmp_path, plate_driver, monkeypatch
):
    again = [1.0, 1.5]

    class Again(OpenLoop):
        def took(self, rows):
            self._requests[1:1] = [self._requests[0]] if again else []
            again.clear()
            super().took(rows)

    monkeypatch.setattr(adaptive, "OpenLoop", Again)
    for _ in range(2):
        with pytest.raises(SensorError, match="took 1 ms, which it had taken before"):
            loop()
        again.append(1.0)
    assert len(CampaignFolder(tmp_path / "door")) == 1
    assert CampaignFolder(tmp_path / "door" / "repeated").keys() == (("near", 1.0),)


def test_a_capture_that_contradicts_itself_is_kept_aside_and_the_loop_goes_on(
    loop, tmp_path, plate_driver, content
):
    def in_metres(driver):
        whole = driver.capture

        def capture(exposure_ms, camera_from_part, *, view):
            taken = whole(exposure_ms, camera_from_part, view=view)
            return replace(taken, cloud=taken.cloud.scaled(0.001)) if view == "far" else taken

        driver.capture = capture
        return driver

    loop(folder="whole")
    with pytest.raises(ContradictionError, match=r"view 'far'.* m.*kept in .*contradicted") as told:
        loop(in_metres(plate_driver()))
    assert told.value.contradictions
    aside = CampaignFolder(tmp_path / "door" / CONTRADICTED_FOLDER)
    assert aside.keys() == (("far", 12.0),)
    assert len(CampaignFolder(tmp_path / "door")) == 2
    shutil.rmtree(aside.path)
    loop()
    assert content(tmp_path / "door") == content(tmp_path / "whole")


def test_a_folder_goes_on_with_the_same_plan_and_driver_only(
    loop, tmp_path, plate_plan, plate_driver, sheet_plan, alone
):
    loop()
    other = replace(plate_plan, target_p_norm=0.9)
    with pytest.raises(InputError, match="measured with another exposure plan"):
        loop(plan=other)

    class Other(plate_driver):
        def description(self):
            return {"driver": "another"}

    with pytest.raises(InputError, match=r"another driver or other settings of it, .* driver"):
        loop(Other())
    shutil.copytree(alone, tmp_path / "of a plan")
    with pytest.raises(InputError, match=r"choose another folder"):
        loop(folder="of a plan")


def test_a_wrong_sensor_or_part_is_refused_before_anything_is_captured(
    loop, tmp_path, plate_driver, plate_plan
):
    with pytest.raises(SensorError, match="the plan is for sensor 'small', the driver has 'large'"):
        loop(plate_driver(name="large"))
    driver = plate_driver()
    driver.part = type(driver.part)(name="plate", features=driver.part.features[:2])
    with pytest.raises(FeatureError, match="d1"):
        loop(driver)
    for name in ("other", "plate"):
        named = replace(plate_plan, part=name)
        driver.part = replace(plate_driver().part, name="door" if name == "plate" else "plate")
        with pytest.raises(InputError, match=f"the plan is for part '{name}', got "):
            loop(driver, plan=named)
    driver.part = None
    with pytest.raises(InputError, match="give it as `part`"):
        loop(driver)
    nowhere = replace(plate_plan.views[1], camera_from_part=None)
    with pytest.raises(InputError, match="the poses of far are not known"):
        loop(plan=replace(plate_plan, views=(plate_plan.views[0], nowhere)))
    assert not (tmp_path / "door").exists()


def test_a_folder_has_one_writer(loop, plate_driver):
    driver = plate_driver()
    capture = driver.capture

    def meanwhile(*arguments, **options):
        with pytest.raises(FileError, match="another writer"):
            loop()
        return capture(*arguments, **options)

    driver.capture = meanwhile
    loop(driver)
    assert len(driver.taken) == 3

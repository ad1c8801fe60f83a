"""Exposure plans as files: what is written is read, and what contradicts itself is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

import exposight as xs
from exposight.cell import sensor_preset
from exposight.errors import FormatError, InputError, MissingFileError, SensorError, VersionError
from exposight.geometry import RigidTransform
from exposight.planning import (
    PROFILES,
    CaptureChances,
    ModelReference,
    parse_exposure_plan,
    plan_exposures,
    read_exposure_plan,
    write_exposure_plan,
)
from exposight.plans import read_plan, write_plan

SENSOR = sensor_preset("rc-visard-65")
LIMITS = PROFILES["rc-visard-65"]


@pytest.fixture(scope="module")
def plan():
    at = LIMITS.settings(0.1, 18.0, 40)
    windows = {
        "near": [(0.5, 1.5), (4.0, 9.0), (np.nan, np.nan)],
        "far": [(2.0, 7.0), (5.0, 16.0), (np.nan, np.nan)],
    }
    views = [
        CaptureChances.of_windows(ends, at, features=("a", "b", "lost"), std=0.05, view=name)
        for name, ends in windows.items()
    ]
    poses = {
        name: RigidTransform(translation_mm=np.array([0.0, 0.0, z]))
        for name, z in (("near", 400.0), ("far", 700.0))
    }
    return plan_exposures(
        views,
        LIMITS,
        poses=poses,
        sensor=SENSOR.name,
        part="door",
        models=(ModelReference(name="quality", sha256="0" * 64),),
        remarks=("made up",),
    )


def test_it_comes_back_as_it_was_written(plan, tmp_path):
    path = tmp_path / "plan.json"
    write_exposure_plan(path, plan)
    assert read_exposure_plan(path) == plan
    plan.write(path)
    assert xs.read_exposure_plan(path) == plan
    raw = json.loads(path.read_text("utf-8"))
    assert (raw["format"], raw["version"]) == ("exposight plan", 1)
    exposure = raw["views"][0]["exposures"][0]
    assert exposure["set_unit"] == "s"
    assert exposure["set_value"] == pytest.approx(exposure["exposure_ms"] / 1000.0)


def test_it_shows_its_answer(plan):
    assert plan.verdict in str(plan)
    assert plan.verdict in plan._repr_html_()
    assert plan.table.frame["feature"][0] == "lost"  # those that fail first
    assert plan.view_table.frame.height == len(plan.views)


@pytest.mark.parametrize(
    ("change", "error", "fact"),
    [
        (lambda raw: raw.pop("views"), FormatError, "key 'views' is missing"),
        (lambda raw: raw.update(version=9), VersionError, "version 9"),
        (lambda raw: raw.update(confidence="0.9"), FormatError, "key 'confidence'"),
        (lambda raw: raw.update(more=1), FormatError, "key 'more' is unknown"),
        (lambda raw: raw["views"].append(raw["views"][0]), FormatError, "is there twice"),
        (lambda raw: raw["views"][0].update(exposures=[]), FormatError, "has no exposure"),
        (
            lambda raw: raw["views"][0]["exposures"][0].update(exposure_ms=900.0),
            FormatError,
            "cannot be set to 900 ms",
        ),
        (
            lambda raw: raw["views"][0]["exposures"][0].update(set_value=5.0),
            FormatError,
            "is not 5 s",
        ),
        (lambda raw: raw["features"][0].update(chance=1.5), FormatError, "between 0 and 1"),
        (lambda raw: raw.update(target_p_norm=0.0), FormatError, "target_p_norm .* got 0"),
        (lambda raw: raw.update(target_p_norm=1.5), FormatError, "target_p_norm .* got 1.5"),
        (lambda raw: raw.update(confidence=1.0), FormatError, "confidence .* got 1"),
        (lambda raw: raw.update(confidence=-0.1), FormatError, "confidence .* got -0.1"),
        (
            lambda raw: raw["features"][0].update(view="elsewhere"),
            FormatError,
            "planned in view 'elsewhere'",
        ),
    ],
)
def test_what_contradicts_itself_is_refused(plan, change, error, fact):
    raw = json.loads(plan.to_json())
    change(raw)
    with pytest.raises(error, match=fact):
        parse_exposure_plan(json.dumps(raw), "plan.json")


def test_a_file_that_is_cut_off_or_not_there(plan, tmp_path):
    path = tmp_path / "plan.json"
    path.write_text(plan.to_json()[:-20], "utf-8")
    with pytest.raises(FormatError, match="was it cut off"):
        read_exposure_plan(path)
    with pytest.raises(MissingFileError):
        read_exposure_plan(tmp_path / "none.json")


def test_a_measuring_plan_of_it(plan, tmp_path):
    path = tmp_path / "next.toml"
    write_plan(path, plan.measuring_plan(SENSOR))
    (poses,) = read_plan(path).poses
    taken = {view.name: sorted(e.exposure_ms for e in view.exposures) for view in plan.views}
    assert dict(zip(poses.names, map(list, poses.exposures_each_ms), strict=True)) == taken
    with pytest.raises(SensorError, match="the plan is for sensor"):
        plan.measuring_plan(sensor_preset("comet-pro-ae"))
    nowhere = replace(plan, views=tuple(replace(v, camera_from_part=None) for v in plan.views))
    with pytest.raises(InputError, match="are not known"):
        nowhere.measuring_plan(SENSOR)

"""An exposure plan carried out by ``measure`` at once, and by ``next`` step by step."""

import json
from dataclasses import replace

import numpy as np
import pytest

from exposight.cell import CampaignFolder, CampaignWriter
from exposight.planning import (
    CaptureCosts,
    ExposureLimits,
    FeatureOutlook,
    ModelReference,
    PlannedExposure,
    SensorModels,
)
from exposight.planning.exposure_plan import (
    Certificate,
    ExposurePlan,
    PlanView,
    Promise,
    write_exposure_plan,
)
from exposight.twin import SimulatedCell

RECORDED_MS = (1.0, 3.0, 6.0, 10.0, 16.0, 40.0)


@pytest.fixture(scope="module")
def exposure_plan(campaign):
    """One capture of the plate from 600 mm, at which its holes are too dark."""
    recorded = CampaignFolder(campaign)
    poses = {each.view: each.camera_from_part for each in recorded.descriptions()}
    names = [each.name for each in recorded.part.features if each.name != "far"]
    first = PlannedExposure(exposure_ms=1.0, set_value=1000.0, set_unit="us", order=1, covers=())
    return ExposurePlan(
        sensor="small",
        part="plate",
        target_p_norm=0.75,
        confidence=0.9,
        goal="count",
        limits=ExposureLimits(
            name="recorded", min_ms=0.5, max_ms=50.0, increment_ms=0.5, allowed_ms=RECORDED_MS,
            unit="us",
        ),
        costs=CaptureCosts(),
        views=(PlanView(name="z600", camera_from_part=poses["z600"], exposures=(first,)),),
        features=tuple(
            FeatureOutlook(
                feature=name, status="planned", chance=0.95, view="z600", exposure_ms=1.0
            )
            for name in names
        ),
        promise=Promise(
            expected_covered=11.4,
            expected_misses=0.6,
            chance_of_all=0.4,
            chance_of_all_if_independent=0.5,
            correlation="one capture",
        ),
        certificate=Certificate(
            objective=1, bound=1, unit="captures", gap=0.0, proven=True, seconds=0.1
        ),
    )  # fmt: skip


@pytest.fixture
def plan(exposure_plan, tmp_path):
    path = tmp_path / "plan.json"
    write_exposure_plan(path, exposure_plan)
    return path


@pytest.fixture
def replay(campaign):
    return ("--driver", "replay", "--recording", campaign)


def test_the_closed_loop_gets_what_the_open_one_misses(plan, replay, models, tmp_path, run_json):
    taken_as_it_is = run_json("measure", plan, *replay, "--open-loop", "-o", tmp_path / "open")
    assert (taken_as_it_is["captures"], taken_as_it_is["achieved"]) == (1, 0)
    assert "0.75 is needed" in taken_as_it_is["failed"]["h01"]
    corrected = run_json("measure", plan, *replay, "--models", models, "-o", tmp_path / "closed")
    assert corrected["achieved"] == 12
    assert corrected["promised"] == 11.4
    assert corrected["outcomes"][0]["planned_chance"] == 0.95
    assert corrected["outcomes"][0]["chance_when_taken"] > 0.5
    assert corrected["captures"] <= 4
    assert len(corrected["decisions"]) == corrected["captures"]
    again = run_json("measure", plan, *replay, "--models", models, "-o", tmp_path / "closed")
    assert again["captures_before"] == again["captures"] == corrected["captures"]
    assert again["outcomes"] == corrected["outcomes"]


def test_each_decision_is_a_line_and_the_answer_comes_first(plan, replay, models, tmp_path, run):
    output = tmp_path / "closed"
    ended = run("measure", plan, *replay, "--models", models, "-o", output)
    assert ended.exit_code == 0, ended.stderr
    assert "12 of 12 features succeeded, 11.4 were promised" in ended.stdout.splitlines()[0]
    lines = [line for line in ended.stderr.splitlines() if line.startswith("1. ")]
    assert len(lines) == 1
    assert "→ z600" in lines[0]
    assert f"wrote the decisions: {output / 'decisions.jsonl'}" in ended.stdout


def test_views_are_merged_afterwards(plan, exposure_plan, replay, tmp_path, run_json):
    merged, words = tmp_path / "merged", ("--open-loop", "--merge", tmp_path / "merged")
    told = run_json("measure", plan, *replay, *words, "-o", tmp_path / "one")
    assert "no view has several captures, so nothing was merged" in told["notes"]
    (view,) = exposure_plan.views
    more = replace(view.exposures[0], exposure_ms=3.0, set_value=3000.0, order=2)
    view = replace(view, exposures=(*view.exposures, more))
    write_exposure_plan(plan, replace(exposure_plan, views=(view,)))
    told = run_json("measure", plan, *replay, *words, "-o", tmp_path / "two")
    assert told["merged"]
    assert len(CampaignFolder(merged)) == 1


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        ((), 2, "give --models, which correct the plan, or --open-loop"),
        (("--open-loop", "--models", "x"), 2, "or --open-loop to take it as it is"),
        (("--open-loop", "--lamp", 0.5), 2, "are of the simulated cell, not of others"),
        (("--open-loop", "--observe"), 2, "leave out --observe, --workers and --cluster"),
        (("--open-loop", "--workers", 2), 2, "leave out --observe, --workers and --cluster"),
        (("--open-loop", "--merge", "m", "--no-clouds"), 2, "leave out --no-clouds"),
    ],
)
def test_a_wrong_call_is_named(words, status, message, plan, replay, run):
    ended = run("measure", plan, *replay, *words)
    assert ended.exit_code == status
    assert message in " ".join(ended.stderr.split())


def test_models_are_not_for_a_measuring_plan(replay, run):
    ended = run("measure", "small", *replay, "--models", "m")
    assert ended.exit_code == 2
    assert "go with an exposure plan" in ended.stderr


def test_a_recording_that_lacks_an_exposure_time_says_so(
    exposure_plan, replay, models, tmp_path, run
):
    free = ExposureLimits(name="free", min_ms=2.0, max_ms=9.0, increment_ms=7.0)
    capture = PlannedExposure(exposure_ms=9.0, set_value=9.0, set_unit="ms", order=1, covers=())
    view = replace(exposure_plan.views[0], exposures=(capture,))
    features = tuple(replace(each, exposure_ms=9.0) for each in exposure_plan.features)
    path = tmp_path / "free.json"
    write_exposure_plan(path, replace(exposure_plan, limits=free, views=(view,), features=features))
    ended = run("measure", path, *replay, "--open-loop", "-o", tmp_path / "door")
    assert ended.exit_code == 1
    assert "has view 'z600' at 1, 3, 6, 10, 16, 40 ms, not at 9 ms" in ended.stderr
    assert "exposight plan --limits FILE" in " ".join(ended.stderr.split())


def test_the_simulated_cell_takes_settings_of_a_file_and_by_name(
    exposure_plan, sheet_plan, scene, tmp_path, run_json, run
):
    pose = sheet_plan.views(SimulatedCell.for_plan(sheet_plan, scene=scene).part)[0]
    capture = PlannedExposure(exposure_ms=100.0, set_value=100.0, set_unit="ms", order=1, covers=())
    view = PlanView(name="v", camera_from_part=pose.camera_from_part, exposures=(capture,))
    feature = FeatureOutlook(
        feature="h0", status="planned", chance=0.9, view="v", exposure_ms=100.0
    )
    path, cell = tmp_path / "sheet.json", tmp_path / "cell.toml"
    limits = ExposureLimits.of(sheet_plan.sensor)
    changes = {
        "part": "",
        "sensor": sheet_plan.sensor.name,
        "views": (view,),
        "features": (feature,),
        "promise": replace(exposure_plan.promise, expected_covered=0.9, expected_misses=0.1),
    }
    write_exposure_plan(path, replace(exposure_plan, limits=limits, **changes))
    cell.write_text(f'scene = "{scene}"\n', "utf-8")
    words = ("--driver", "simulated", "--open-loop", "--cell", cell, "--rings-only")
    bright = run_json("measure", path, *words, "-o", tmp_path / "bright")
    dim = run_json("measure", path, *words, "--lamp", 0.02, "-o", tmp_path / "dim")
    assert (bright["achieved"], dim["achieved"]) == (1, 0)
    ended = run("measure", path, *words, "--merge", tmp_path / "m", "-o", tmp_path / "never")
    assert ended.exit_code == 2
    assert "--rings-only simulates the rings alone" in " ".join(ended.stderr.split())
    assert not (tmp_path / "never").exists()


def test_a_simulated_cell_needs_a_sensor_that_somebody_describes(plan, run):
    ended = run("measure", plan, "--driver", "simulated", "--open-loop")
    assert ended.exit_code == 1
    assert "nobody describes the plan's sensor 'small'" in ended.stderr


# -- step by step -------------------------------------------------------------------------------


@pytest.fixture
def begin(plan, models, campaign, tmp_path):
    state = tmp_path / "loop.json"
    return (state, "--plan", plan, "--models", models, "--campaign", campaign)


def test_a_program_is_led_from_request_to_request(begin, plan, replay, models, tmp_path, run_json):
    at_once = run_json("measure", plan, *replay, "--models", models, "-o", tmp_path / "door")
    state, captures = begin[0], sorted((tmp_path / "door" / "captures").iterdir())
    asked = [run_json("next", *begin)]
    for capture in captures:
        asked.append(run_json("next", state, "--capture", capture))
    requests = [each["request"] for each in asked[:-1]]
    assert [each["exposure_ms"] for each in requests] == [
        each["asked_ms"] for each in at_once["decisions"]
    ]
    for request in requests:
        assert request["view"] == "z600"
        assert request["camera_from_part"][2] == [0.0, 0.0, 1.0, 600.0]
        assert request["fanuc"] == "0,0,600,0,0,0"
        assert request["set_value"] == 1000 * request["exposure_ms"]
        assert request["set_unit"] == "us"
        assert request["why"]
    assert asked[-1]["done"]
    assert asked[-1]["request"] is None
    assert asked[-1]["outcomes"] == at_once["outcomes"]
    # what was fed before is known, as single captures, as a campaign or as a table
    known = (tmp_path / "door", tmp_path / "door" / "observations.csv", *captures)
    fed_again = run_json("next", state, "--capture", *known)
    assert fed_again["fed"] == []
    assert fed_again["notes"][0].startswith("known already: view z600 at ")
    assert run_json("next", *begin)["done"]


def test_a_sensor_that_clamps_is_led_to_an_end(begin, campaign, run_json):
    """Whatever it is asked for, it takes 40 ms, and all its images clip alike."""
    clamped = campaign / "captures" / "000011"  # z600 at 40 ms
    asked = run_json("next", *begin)
    notes, calls = [], 0
    while not asked["done"]:
        asked = run_json("next", begin[0], "--capture", clamped)
        notes += asked["notes"]
        calls += 1
        assert calls < 40
    assert any("took 40 ms where" in note for note in notes)
    assert "known already: view z600 at 40 ms" in notes
    assert {each["status"] for each in asked["outcomes"]} == {"given up"}


@pytest.fixture
def dark_campaign(campaign, tmp_path):
    """Return the plate's campaign with images of another, dark moment."""
    recorded = CampaignFolder(campaign)
    folder = tmp_path / "dark"
    with CampaignWriter.open_or_create(
        folder, name=recorded.name, sensor=recorded.sensor, part=recorded.part
    ) as writer:
        for capture in recorded.captures():
            writer.add(replace(capture, image=np.zeros_like(capture.image)))
    return folder


def test_what_does_not_agree_in_captures_is_told(
    begin, plan, exposure_plan, dark_campaign, tmp_path, run_json
):
    def checks(told):
        return [each["check"] for each in told["contradictions"]]

    replayed = ("--driver", "replay", "--recording", dark_campaign, "--open-loop")
    bright = ("--capture", dark_campaign / "captures" / "000007")  # z600 at 3 ms
    run_json("next", *begin)
    assert "points-in-the-dark" in checks(run_json("next", begin[0], *bright))
    (view,) = exposure_plan.views
    lit = replace(view.exposures[0], exposure_ms=3.0, set_value=3000.0)
    write_exposure_plan(
        plan,
        replace(
            exposure_plan,
            views=(replace(view, exposures=(lit,)),),
            features=tuple(replace(each, exposure_ms=3.0) for each in exposure_plan.features),
        ),
    )
    told = run_json("measure", plan, *replayed, "-o", tmp_path / "measured")
    assert "points-in-the-dark" in checks(told)


def test_people_read_the_request_first(begin, run):
    ended = run("next", *begin)
    assert ended.exit_code == 0, ended.stderr
    first = ended.stdout.splitlines()[0]
    assert first.startswith("capture z600 at ")
    assert first.endswith(" us")
    assert "fanuc 0,0,600,0,0,0" in ended.stdout


def test_plan_and_state_are_known(begin, campaign, exposure_plan, run_json):
    told = run_json("info", begin[2])
    assert (told["kind"], told["answer"]) == ("exposure plan", exposure_plan.verdict)
    run_json("next", *begin, "--capture", campaign / "captures" / "000007")
    told = run_json("info", begin[0])
    assert (told["kind"], told["captures"]) == ("state of a loop", 1)


def test_models_other_than_the_plans_are_noted(
    exposure_plan, models, replay, campaign, tmp_path, run_json
):
    path, note = tmp_path / "noted.json", "the plan was made with other models than these: "
    begin = ("--plan", path, "--models", models, "--campaign", campaign)
    made_with = SensorModels.load(models).checksums
    for changed, notes in ((), []), (made_with.keys(), [note + ", ".join(made_with)]):
        references = tuple(
            ModelReference(name=name, sha256="0" * 64 if name in changed else sha256)
            for name, sha256 in made_with.items()
        )
        write_exposure_plan(path, replace(exposure_plan, models=references))
        state, folder = tmp_path / f"{len(notes)}.json", tmp_path / f"{len(notes)}"
        assert run_json("next", state, *begin)["notes"] == notes
        told = run_json("measure", path, *replay, "--models", models, "-o", folder)
        assert told["notes"] == notes


def test_a_state_that_is_not_there_or_of_another_loop(begin, exposure_plan, tmp_path, run):
    state = begin[0]
    ended = run("next", state)
    assert ended.exit_code == 1
    assert "begin one with --plan and --models" in ended.stderr
    ended = run("next", state, "--plan", begin[2])
    assert ended.exit_code == 2
    assert "begins with --plan and --models" in ended.stderr
    assert run("next", *begin).exit_code == 0
    other = tmp_path / "other.json"
    write_exposure_plan(other, replace(exposure_plan, target_p_norm=0.5))
    ended = run("next", state, "--plan", other, *begin[3:])
    assert ended.exit_code == 1
    assert "is the state of another loop" in ended.stderr
    state.write_text(state.read_text("utf-8").replace("plate", "plaet", 1), "utf-8")
    ended = run("next", state, "--json")
    assert json.loads(ended.stdout)["error"]["type"] == "DamagedFileError"

"""A perforated sheet measured by plan: by any number of workers, through any interruption."""

import errno
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exposight.cell import CampaignFolder, CampaignWriter, sensor_preset
from exposight.errors import (
    FeatureError,
    FileError,
    InputError,
    MissingFileError,
    NumericalError,
    SensorError,
)
from exposight.observing import observe_campaign
from exposight.twin.plan import DepthPlane, MeasuringPlan
from exposight.twin.plan_file import read_plan, write_plan
from exposight.twin.scene import Scene, check_scene
from exposight.twin.scene_files import export_scene
from exposight.twin.simulated_cell import CellSettings, simulate, simulate_observations

HOLES = ((-25.0, -12.0, 4.0), (15.0, 10.0, 7.0))
EXPOSURES_MS = (30.0, 330.0)
"""p_norm is partly between 0 and 1 at both: darkness at one, clipping at the other."""

PLAN = MeasuringPlan(
    name="sheet",
    sensor="comet-pro-ae",
    features=("h0", "h1"),
    reference="h0",
    planes=(
        DepthPlane(
            name="middle",
            z_tcp_mm=-5.0,
            x_mm=(-60.0, 60.0),
            y_mm=(-30.0, 30.0),
            exposures_ms=EXPOSURES_MS,
            kinematic_share=0.5,
        ),
    ),
    seed=1,
)
ONE_VIEW = replace(PLAN, planes=(replace(PLAN.planes[0], x_mm=(-60.0,), y_mm=(-30.0,)),))
"""The first view of the plan: it has the same name, and so the same errors and noise."""

STEREO = MeasuringPlan(
    name="stereo sheet",
    sensor="rc-visard-65",
    features=("h0", "h1"),
    reference="h0",
    planes=(
        DepthPlane(name="middle", z_tcp_mm=0.0, x_mm=(0.0,), y_mm=(0.0,), exposures_ms=(9.0,)),
    ),
)


def thickened(sheet, part, thickness_mm=2.0) -> Scene:
    """Give a sheet, which faces −z, a back and edges."""
    n = len(sheet.vertices)
    edges = np.concatenate([sheet.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    there = set(map(tuple, edges.tolist()))
    rim = np.array([(a, b) for a, b in there if (b, a) not in there])
    a, b = rim.T
    walls = np.concatenate([np.column_stack([b, a, a + n]), np.column_stack([b, a + n, b + n])])
    faces = np.concatenate([sheet.faces, sheet.faces[:, ::-1] + n, walls])
    scene = Scene(
        vertices=np.concatenate([sheet.vertices, np.add(sheet.vertices, [0, 0, thickness_mm])]),
        faces=faces,
        face_finish=np.full(len(faces), sheet.face_finish[0]),
        part=part,
    )
    if scene.volume_mm3() < 0:
        scene = replace(scene, faces=scene.faces[:, ::-1])
    return check_scene(scene)


@pytest.fixture(scope="module")
def scene(tmp_path_factory, plate, hole_part) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    export_scene(
        folder, thickened(plate("primer", HOLES), hole_part(HOLES)), sensor_preset("comet-pro-ae")
    )
    return folder


@pytest.fixture(scope="module")
def rings(scene) -> CellSettings:
    return CellSettings(rings_only=True, scene=scene)


@pytest.fixture(scope="module")
def alone(tmp_path_factory, rings) -> Path:
    """The whole plan by one worker, uninterrupted, rings only."""
    return simulate(PLAN, tmp_path_factory.mktemp("alone") / "sheet", rings).path


@pytest.fixture(scope="module")
def whole(tmp_path_factory, scene) -> CampaignFolder:
    """One view in whole frames."""
    return simulate(ONE_VIEW, tmp_path_factory.mktemp("whole"), CellSettings(scene=scene))


def content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


# -- the same, however it is done ---------------------------------------------------------------


def test_a_plan_becomes_a_campaign_in_its_order(alone):
    campaign = CampaignFolder(alone)
    views = [f"middle-x{i}-y{j}" for j in (1, 2) for i in (1, 2)]
    assert campaign.keys() == tuple((view, t) for view in views for t in EXPOSURES_MS)
    assert campaign.name == "sheet"
    assert [feature.name for feature in campaign.part.features] == ["h0", "h1"]


def test_notes_tell_how_a_view_was_aligned_and_what_was_taken(alone):
    notes = [capture.notes for capture in CampaignFolder(alone).captures()]
    assert {note.split(",")[0] for note in notes} == {
        "aligned by kinematics",
        "aligned by photogrammetry",
    }
    assert all(note.endswith("only the neighbourhoods of the rings were taken") for note in notes)


def test_two_workers_give_the_same_bytes_as_one(tmp_path, alone, rings):
    reports = []
    folder = simulate(
        PLAN, tmp_path / "two", replace(rings, workers=2), lambda *n: reports.append(n)
    ).path
    assert content(folder) == content(alone)
    assert reports == [(done, 8) for done in (0, 2, 4, 6, 8)]


def test_rings_only_measure_the_same_as_whole_frames(whole, alone):
    rings = observe_campaign(CampaignFolder(alone)).frame
    same_view = rings.filter(rings["view"] == "middle-x1-y1")
    assert observe_campaign(whole).frame.equals(same_view)
    assert same_view["p_norm"].is_between(0.02, 0.98).any()  # not only all or nothing


def test_whole_frames_are_organised(whole):
    captures = list(whole.captures())
    assert all(capture.cloud.organised for capture in captures)
    assert max(capture.cloud.n_valid for capture in captures) > 10_000


def test_observing_at_once_equals_observing_the_campaign(alone, rings):
    reports = []
    table = simulate_observations(PLAN, replace(rings, workers=2), lambda *n: reports.append(n))
    assert table.frame.equals(observe_campaign(CampaignFolder(alone)).frame)
    assert reports[-1] == (8, 8)


def test_active_stereo_is_taken_in_whole_frames(tmp_path, scene):
    campaign = simulate(STEREO, tmp_path / "one", CellSettings(scene=scene))
    captures = list(campaign.captures())
    assert campaign.keys() == (("middle-x1-y1", 9),)
    assert captures[0].cloud.organised
    assert captures[0].cloud.n_valid > 10_000


# -- interruptions ------------------------------------------------------------------------------

RUN = """
import sys
from pathlib import Path
from exposight.twin.plan_file import read_plan
from exposight.twin.simulated_cell import CellSettings, simulate

plan, scene, folder, workers = sys.argv[1:]
settings = CellSettings(rings_only=True, workers=int(workers), scene=Path(scene))
simulate(read_plan(plan), folder, settings, lambda *_: print(flush=True))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_a_run_killed_at_random_moments_goes_on_to_the_same_bytes(tmp_path, alone, rings, scene):
    moments = random.Random(5)
    folder, plan = tmp_path / "killed", tmp_path / "plan.toml"
    write_plan(plan, PLAN)
    counts = []
    for workers in (1, 2, 1):
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, *map(str, (plan, scene, folder, workers))],
            stdout=subprocess.PIPE,
        )
        assert process.stdout is not None
        process.stdout.readline()  # the first report: it is about to begin
        begun = sum(1 for _ in (folder / "captures").iterdir())
        deadline = time.monotonic() + 60
        while sum(1 for _ in (folder / "captures").iterdir()) == begun and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.001)
        time.sleep(moments.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)  # its workers are left to themselves
        process.wait()
        process.stdout.close()
        counts.append(len(list(CampaignFolder(folder).captures())))
    assert counts == sorted(counts)
    simulate(PLAN, folder, rings)
    assert content(folder) == content(alone)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_a_worker_that_is_killed_is_told_and_costs_no_capture(tmp_path, alone, rings):
    folder = tmp_path / "campaign"

    def kill_one(done: int, _total: int) -> None:
        if done == 2:
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    message = r"a worker process died .*what was captured is kept: run again"
    with pytest.raises(NumericalError, match=message):
        simulate(PLAN, folder, replace(rings, workers=2), kill_one)
    assert not multiprocessing.active_children()
    assert 2 <= len(list(CampaignFolder(folder).captures())) < 8
    first = []
    simulate(PLAN, folder, rings, lambda done, _: first.append(done))
    assert first[0] >= 2
    assert content(folder) == content(alone)


def test_an_interrupt_ends_the_workers_before_the_next_writer_is_let_in(tmp_path, alone, rings):
    def interrupt(done: int, _total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    folder = tmp_path / "campaign"
    with pytest.raises(KeyboardInterrupt):
        simulate(PLAN, folder, replace(rings, workers=2), interrupt)
    assert not multiprocessing.active_children()
    simulate(PLAN, folder, rings)
    assert content(folder) == content(alone)


def test_a_deleted_capture_is_taken_again(tmp_path, alone, rings):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    shutil.rmtree(folder / "captures" / "000003")
    reports = []
    simulate(PLAN, folder, rings, lambda *n: reports.append(n))
    assert reports == [(7, 8), (8, 8)]
    assert content(folder) == content(alone)


# -- what cannot be -----------------------------------------------------------------------------


def test_the_folder_of_another_plan_is_refused(tmp_path, alone, rings):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    for other, difference in (
        (replace(PLAN, seed=9), "another plan, differing in seed; go on with that, or choose"),
        (replace(PLAN, lighting="III"), "another plan, differing in lighting"),
        (ONE_VIEW, "another plan, differing in planes"),
    ):
        with pytest.raises(InputError, match=difference):
            simulate(other, folder, rings)
    with pytest.raises(InputError, match="'sheet' and not 'roof'"):
        simulate(replace(PLAN, name="roof"), folder, rings)
    assert content(folder) == content(alone)


def test_whole_frames_and_rings_are_not_mixed(alone, whole, rings, scene):
    with pytest.raises(InputError, match="simulated with rings only, not whole frames"):
        simulate(PLAN, alone, CellSettings(scene=scene))
    with pytest.raises(InputError, match="simulated with whole frames, not rings only"):
        simulate(ONE_VIEW, whole.path, rings)


def test_another_scene_is_refused(tmp_path, alone, plate, hole_part):
    shiny = thickened(plate("bare", HOLES), hole_part(HOLES))
    export_scene(tmp_path, shiny, sensor_preset(PLAN.sensor))
    with pytest.raises(InputError, match="simulated with another scene"):
        simulate(PLAN, alone, CellSettings(rings_only=True, scene=tmp_path))


def test_captures_that_were_not_simulated_are_refused(tmp_path, whole, rings):
    recorded = replace(next(whole.captures()), view="recorded")
    with CampaignWriter.open_or_create(
        tmp_path / "cell", name=PLAN.name, sensor=whole.sensor, part=whole.part
    ) as writer:
        writer.add(recorded)
    with pytest.raises(InputError, match=r"1 captures and no simulation\.json: they were not"):
        simulate(PLAN, tmp_path / "cell", rings)


def test_captures_added_by_hand_are_refused(tmp_path, alone, rings):
    folder = tmp_path / "campaign"
    shutil.copytree(alone, folder)
    (folder / "captures" / "000003").rename(folder / "captures" / "000009")
    with pytest.raises(InputError, match="at 330 ms as capture 9, which this plan does not"):
        simulate(PLAN, folder, rings)


def test_the_plan_lies_in_the_folder(alone):
    assert read_plan(alone / "plan.toml") == PLAN


def test_an_error_in_a_worker_names_plan_view_and_capture(tmp_path, rings):
    def block(done: int, _total: int) -> None:
        if done == 0:
            (tmp_path / "captures" / "000005").mkdir()

    message = r"plan 'sheet', view 'middle-x1-y2': .*000005 was not written: File exists"
    with pytest.raises(FileError, match=message):
        simulate(PLAN, tmp_path, replace(rings, workers=2), block)


def test_a_disk_that_fills_up_costs_no_capture(tmp_path, alone, rings, monkeypatch):
    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    folder = tmp_path / "campaign"
    with monkeypatch.context() as patch:

        def fill_up(done: int, _total: int) -> None:
            if done == 4:
                patch.setattr(os, "fsync", no_space)

        with pytest.raises(FileError, match=r"view 'middle-x1-y2': .*the disk is full"):
            simulate(PLAN, folder, rings, fill_up)
    assert len(list(CampaignFolder(folder).captures())) == 4
    simulate(PLAN, folder, rings)
    assert content(folder) == content(alone)


def test_errors_of_the_plan_come_before_any_folder(tmp_path, rings):
    folder = tmp_path / "campaign"
    plane = PLAN.planes[0]
    for plan, error, message in (
        (replace(PLAN, features=("h7",)), FeatureError, "plan 'sheet': .*'h7'"),
        (
            replace(PLAN, planes=(replace(plane, x_mm=(900.0,)),)),
            InputError,
            "view 'middle-x1-y1' sees none of its features",
        ),
        (
            replace(PLAN, planes=(replace(plane, exposures_ms=(2000.0,)),)),
            SensorError,
            "'middle'.*from 1 to 1000 ms, got 2000 ms",
        ),
    ):
        with pytest.raises(error, match=message):
            simulate(plan, folder, rings)
        with pytest.raises(error, match=message):
            simulate_observations(plan, rings)
    assert not folder.exists()


def test_rings_of_a_stereo_sensor_are_refused(tmp_path, rings):
    with pytest.raises(InputError, match="'rc-visard-65' matches whole images"):
        simulate(STEREO, tmp_path, rings)
    with pytest.raises(InputError, match="take whole frames"):
        simulate_observations(STEREO, rings)


def test_a_scene_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no mesh at .*nowhere"):
        simulate(PLAN, tmp_path / "c", CellSettings(scene=tmp_path / "nowhere"))


def test_no_worker_is_refused():
    with pytest.raises(InputError, match="at least 1 worker, got 0"):
        CellSettings(workers=0)

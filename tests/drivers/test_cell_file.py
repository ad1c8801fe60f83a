"""Cells' files, and the commands in them that move and project."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from exposight.cell import sensor_preset, write_sensor
from exposight.drivers import GenicamDriver, read_cell
from exposight.drivers.commands import CellCommand
from exposight.drivers.moves import MoveCommand, Mover
from exposight.errors import FormatError, InputError, SensorError
from exposight.geometry import RigidTransform

POSE = RigidTransform.from_fanuc_wpr((1.0, 2.0, 600.25), 10.0, -20.0, 30.0)


def python(code, *arguments):
    return (sys.executable, "-I", "-c", code, *arguments)


# -- commands -----------------------------------------------------------------------------------


def test_values_are_put_in_without_a_shell():
    command = CellCommand(command=python("import sys; print(sys.argv[1:])", "a{x};echo", "{y}"))
    assert command.run("say", {"x": "$HOME 'q'"}).strip() == repr(["a$HOME 'q';echo", "{y}"])


def test_a_command_that_hangs_is_ended():
    command = CellCommand(command=python("import time; time.sleep(60)"), timeout_s=0.3)
    with pytest.raises(SensorError, match=r"show: .* did not end within 0.3 s"):
        command.run("show", {})


def test_a_failing_command_is_quoted():
    command = CellCommand(command=python("import sys; sys.exit('lamp is off')"))
    with pytest.raises(SensorError, match="failed with code 1: lamp is off"):
        command.run("show", {})


def test_a_missing_program_is_named():
    with pytest.raises(SensorError, match="/no/such cannot be run"):
        CellCommand(command=("/no/such",)).run("show", {})


# -- moves --------------------------------------------------------------------------------------


def test_the_pose_printed_is_the_pose_reached(tmp_path):
    code = "import sys; open(sys.argv[1], 'a').write('m'); print(sys.argv[2].replace(',', ' '))"
    moves = tmp_path / "moves"
    mover = Mover(MoveCommand(command=python(code, str(moves), "{matrix}"), notation="matrix"))
    assert mover.move_to(POSE, "v") == POSE
    assert mover.move_to(POSE, "v") == POSE
    assert moves.read_text() == "m"  # once for all exposure times
    assert mover.remark == ""


def test_fanuc_numbers_move_there():
    code = "import sys; print(sys.argv[1].replace(',', ' '))"
    mover = Mover(MoveCommand(command=python(code, "{fanuc}"), notation="fanuc"))
    assert np.allclose(mover.move_to(POSE, "v").to_matrix(), POSE.to_matrix(), atol=1e-9)


@pytest.mark.parametrize(
    "printed",
    [RigidTransform(), POSE.inverse(), RigidTransform.from_fanuc_wpr((0, 0, 60), 0, 0, 0)],
)
def test_a_pose_far_from_the_one_asked_for_is_another_frame_s(printed):
    numbers = ",".join(map(repr, printed.to_matrix().ravel().tolist()))
    mover = Mover(MoveCommand(command=python(f"print('{numbers}')"), notation="matrix"))
    with pytest.raises(SensorError, match=r"from the one asked for.*not the robot's own pose"):
        mover.move_to(POSE, "v")


def test_without_a_printed_pose_it_is_taken_as_asked():
    assert Mover(MoveCommand(command=python("pass"))).move_to(POSE, "v") is POSE
    mover = Mover(None)
    assert mover.move_to(POSE, "v") is POSE
    assert "as asked for" in mover.remark


def test_words_are_no_pose():
    mover = Mover(MoveCommand(command=python("print('arrived')")))
    with pytest.raises(SensorError, match="prints the pose reached, or nothing"):
        mover.move_to(POSE, "v")


# -- files --------------------------------------------------------------------------------------

RIG = """
sensor = "sensor.json"
[camera]
id = "7"
[projector]
command = ["show", "{pattern}"]
[sequence]
name = "board"
"""


@pytest.fixture
def cell_file(tmp_path):
    write_sensor(tmp_path / "sensor.json", sensor_preset("comet-pro-ae"))

    def write(text):
        path = tmp_path / "cell.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_rig_is_read_with_what_it_names(cell_file):
    driver = GenicamDriver.of_file(cell_file(RIG))
    assert driver.sensor == sensor_preset("comet-pro-ae")
    assert driver.part is None
    driver.close()  # nothing was opened


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('id = "7"', 'id = "7"\nspeed = 1', "speed"),
        ("{pattern}", "{patern}", r"unknown placeholder \{patern\}"),
        ('[sequence]\nname = "board"', "", "go together"),
        ('command = ["show", "{pattern}"]', "command = []", "needs a program"),
        ('command = ["show", "{pattern}"]', 'command = ["show", "0"]', "has no {pattern}"),
        ("[projector]", "[stereo]\nmin_texture = 9\n[projector]", "is of two cameras"),
        ("[projector]", '[rc_visard]\nhost = "a"\n[projector]', "in place of"),
        ('id = "7"', 'id = "7"\ntimeout_s = -1', "timeout_s above 0"),
    ],
)
def test_a_wrong_file_is_refused(cell_file, before, after, message):
    assert before in RIG
    with pytest.raises(FormatError, match=message):
        read_cell(cell_file(RIG.replace(before, after)))


def test_cameras_are_as_many_as_the_sensor_s(cell_file):
    stereo = RIG.replace("sensor.json", "rc-visard-65")
    with pytest.raises(SensorError, match=r"has 2 cameras, the cell's file names 1"):
        GenicamDriver.of_file(cell_file(stereo))
    plain = 'sensor = "comet-pro-ae"\n[camera]\nid = "7"\n'
    with pytest.raises(SensorError, match=r"has one camera: .* give \[projector\] and \[sequence"):
        GenicamDriver.of_file(cell_file(plain))


def test_a_command_needs_a_positive_time():
    with pytest.raises(InputError, match="above 0"):
        CellCommand(command=("x",), timeout_s=0.0)

import numpy as np
import pytest

from exposight.cli.app import UsageError
from exposight.cli.app import run as run_program
from exposight.cli.pose import PoseOptions
from exposight.errors import AmbiguousError, PoseError
from exposight.files import Reading, reading_as
from exposight.geometry import RigidTransform

FLANGE = RigidTransform.from_kuka_abc((-900, -250, 1100), 30, 12, 171)
HAND_EYE = RigidTransform.from_fanuc_wpr((40, -75, 120), 3, -5, 88)
PART = RigidTransform.from_fanuc_wpr((4, -3, 500), 180, 8, 0)


@pytest.fixture
def chain(tmp_path):
    for name, pose in (
        ("hand_eye", HAND_EYE),
        ("part", FLANGE @ HAND_EYE @ PART),
        ("flange", FLANGE),
        ("camera", FLANGE @ HAND_EYE),
        ("held", RigidTransform()),
    ):
        np.savetxt(tmp_path / f"{name}.txt", pose.to_matrix())
    return {"hand_eye": tmp_path / "hand_eye.txt", "part_pose": tmp_path / "part.txt"}


@pytest.mark.parametrize(
    "flange",
    [
        ("kuka", "-900,-250,1100,30,12,171"),
        ("printed", "{X -900,Y -250,Z 1100,A 30,B 12,C 171}"),
        ("{X -900,Y -250,Z 1100,A 30,B 12,C 171}",),
    ],
)
def test_the_chain_gives_the_pose(chain, flange):
    pose = PoseOptions(flange=flange, **chain).camera_from_part()
    assert pose.to_matrix() == pytest.approx(PART.to_matrix(), abs=1e-6)


def test_its_links_may_be_files(chain, tmp_path):
    pose = PoseOptions(flange=(str(tmp_path / "flange.txt"),), **chain).camera_from_part()
    assert pose.to_matrix() == pytest.approx(PART.to_matrix(), abs=1e-6)
    fixed = PoseOptions(
        flange=(str(tmp_path / "flange.txt"),),
        camera_in_base=tmp_path / "camera.txt",
        part_pose=tmp_path / "held.txt",
    ).camera_from_part()
    assert fixed.to_matrix() == pytest.approx(HAND_EYE.inverse().to_matrix(), abs=1e-6)


def test_a_robots_numbers_may_stand_in_a_file(tmp_path):
    path = tmp_path / "robot.txt"
    path.write_text("4,-3,500,0,8,180")
    pose = PoseOptions(robot_pose=("kuka", str(path))).camera_from_part()
    assert pose.to_matrix() == pytest.approx(PART.to_matrix(), abs=1e-9)
    with pytest.raises(AmbiguousError, match="which robot"):
        PoseOptions(pose=path).camera_from_part()


def test_what_is_missing_or_too_much_is_named(chain, tmp_path):
    flange = ("kuka", "0,0,0,0,0,0")
    with pytest.raises(UsageError, match="needs --flange"):
        PoseOptions(**chain).camera_from_part()
    with pytest.raises(UsageError, match="either --hand-eye"):
        PoseOptions(flange=flange, part_pose=chain["part_pose"]).camera_from_part()
    with pytest.raises(UsageError, match="once"):
        PoseOptions(flange=flange, pose=tmp_path / "held.txt", **chain).camera_from_part()
    with pytest.raises(PoseError, match="kuka pose needs 6 numbers"):
        PoseOptions(flange=("kuka", "0,0,0"), **chain).camera_from_part()


def test_a_calibration_in_metres_is_asked_for(chain):
    matrix = HAND_EYE.to_matrix()
    matrix[:3, 3] /= 1000
    np.savetxt(chain["hand_eye"], matrix)
    options = PoseOptions(flange=("kuka", "-900,-250,1100,30,12,171"), **chain)
    with pytest.raises(AmbiguousError, match="in mm or in m"):
        options.camera_from_part()
    with reading_as(Reading(unit="m")):  # of the calibration; the part is no 900 m away
        pose = options.camera_from_part()
    assert pose.to_matrix() == pytest.approx(PART.to_matrix(), abs=1e-6)


def test_numbers_that_begin_with_a_minus_are_no_option(capsys):
    assert run_program(["observe", "--flange", "kuka", "-1,2,3,4,5,6", "--exposure-ms", "3"]) == 2
    assert "also needs --image" in capsys.readouterr().err

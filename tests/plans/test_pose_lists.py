"""Lists of poses: what notations and frames mean, names, exposure times, CSV files, and faults."""

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from exposight.cell import sensor_preset
from exposight.errors import FormatError, InputError, MissingFileError
from exposight.geometry import PoseNotation, RigidTransform, pose_columns
from exposight.plans import MeasuringPlan, PoseFrame, PoseList, plan_from_text, plan_to_toml

SENSOR = sensor_preset("comet-pro-ae")
CAMERA_FROM_TCP = SENSOR.camera_from_tcp
ROUNDING = 1e-9

HEAD = """
format = "exposight measuring plan"
version = 3
name = "poses"
sensor = "comet-pro-ae"
features = ["h0"]
"""


def _numbers(notation: str, pose: RigidTransform) -> list[float]:
    """Write a pose down by scipy, independently of our readers."""
    rotation = Rotation.from_matrix(pose.rotation)
    x, y, z = pose.translation_mm.tolist()
    match notation:
        case "fanuc":
            return [x, y, z, *rotation.as_euler("xyz", degrees=True)]
        case "kuka":
            return [x, y, z, *rotation.as_euler("ZYX", degrees=True)]
        case "abb" | "quaternion_wxyz":
            return [x, y, z, *rotation.as_quat(scalar_first=True)]
        case "quaternion_xyzw":
            return [x, y, z, *rotation.as_quat()]
        case "rotation_vector":
            return [x, y, z, *rotation.as_rotvec()]
        case "ur":
            return [x / 1000, y / 1000, z / 1000, *rotation.as_rotvec()]
        case "halcon":
            return [x / 1000, y / 1000, z / 1000, *rotation.as_euler("XYZ", degrees=True), 0]
    return [*np.c_[rotation.as_matrix(), pose.translation_mm].ravel()]


def _plan(*poses: PoseList) -> MeasuringPlan:
    return MeasuringPlan(name="poses", sensor=SENSOR, features=["h0"], poses=poses)


def _robot(**changes) -> PoseList:
    values = {
        "name": "robot",
        "notation": "fanuc",
        "frame": "tcp_from_part",
        "rows": [[0, 0, 0, 0, 0, 0], [5, 0, 0, 0, 10.5, 90]],
        "exposures_ms": [5, 20],
    }
    return PoseList(**{**values, **changes})


_coordinate = st.floats(-2000, 2000)
_quaternion = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@pytest.mark.filterwarnings("ignore:Gimbal lock:UserWarning")
@pytest.mark.parametrize("frame", get_args(PoseFrame))
@pytest.mark.parametrize("notation", get_args(PoseNotation))
@settings(max_examples=20, deadline=None)
@given(position=st.tuples(*[_coordinate] * 3), quaternion=_quaternion)
def test_one_pose_in_every_notation_and_frame(notation, frame, position, quaternion):
    rotation = Rotation.from_quat(quaternion).as_matrix()
    camera_from_part = RigidTransform(rotation=rotation, translation_mm=np.array(position))
    tcp_from_part = CAMERA_FROM_TCP.inverse() @ camera_from_part
    written = {
        "camera_from_part": camera_from_part,
        "part_from_camera": camera_from_part.inverse(),
        "tcp_from_part": tcp_from_part,
        "part_from_tcp": tcp_from_part.inverse(),
    }[frame]
    poses = _robot(notation=notation, frame=frame, rows=[_numbers(notation, written)])
    ((name, *both, times_ms),) = poses.views(CAMERA_FROM_TCP)
    assert (name, times_ms) == ("robot", (5.0, 20.0))
    for pose, expected in zip(both, (camera_from_part, tcp_from_part), strict=True):
        assert pose.to_matrix() == pytest.approx(expected.to_matrix(), abs=1e-7)
    plan = _plan(poses)
    assert plan_from_text(plan_to_toml(plan)) == plan


def test_views_are_numbered_or_have_names_of_their_own(hole_part):
    rows = [[0, 0, z, 0, 0, 0] for z in (-20, 0, 20)]
    part = hole_part(((0, 0, 5),))
    views = _plan(_robot(rows=rows)).views(part)
    assert [(view.name, view.group) for view in views] == [
        (f"robot-0{i}", "robot") for i in (1, 2, 3)
    ]
    named = _plan(_robot(rows=rows, names=["a", "b", "c"])).views(part)
    assert [(view.name, view.group) for view in named] == [(name, "robot") for name in "abc"]


def test_a_pose_may_have_exposure_times_of_its_own(hole_part):
    plan = _plan(_robot(exposures_each_ms=[[5], [5, 40]], exposures_ms=()))
    assert [view.exposures_ms for view in plan.views(hole_part(((0, 0, 5),)))] == [(5,), (5, 40)]
    assert plan.poses[0].exposures_ms == (5, 40)
    assert plan.n_captures == 3
    assert plan_from_text(plan_to_toml(plan)) == plan


def test_a_pose_that_sees_nothing_is_blind(hole_part):
    poses = _robot(rows=[[0, 0, 0, 0, 0, 0], [0, 0, 0, 180, 0, 0]])
    with pytest.raises(InputError, match=r"view 'robot-02' sees none .*h0 facing away"):
        _plan(poses).views(hole_part(((0, 0, 5),)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rows": []}, "poses 'robot': rows is empty"),
        ({"rows": [[0] * 6, [0] * 5]}, "poses 'robot', row 2: a fanuc pose needs 6 .* got 5"),
        ({"rows": [[0] * 5 + [math.nan]]}, "row 1: a Fanuc .* finite"),
        ({"notation": "abb", "rows": [[0] * 3 + [2, 0, 0, 0]]}, "row 1: .*norm 1, got 2"),
        ({"notation": "matrix", "rows": [np.diag([2, 1, 1, 1]).ravel()]}, "row 1: not a rotation"),
        ({"notation": "fanuk"}, "row 1: .*did you mean 'fanuc'"),
        ({"frame": "part"}, "frame must be one of camera_from_part, .*got 'part'"),
        ({"names": ["a"]}, "names needs one entry for each of 2 rows, got 1"),
        ({"names": ["a", "a"]}, "two poses are called 'a'"),
        ({"exposures_ms": []}, "poses 'robot': exposures_ms is empty"),
        ({"exposures_each_ms": [[5], [-5]]}, "row 2: exposures_ms must all be above 0"),
    ],
)
def test_an_impossible_list_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        _robot(**changes)


def test_angles_that_look_like_radians_are_remarked():
    radians = [[0, 0, -600, 0, math.pi / 2, -math.pi]]
    assert "read as degrees; if they are radians" in _robot(rows=radians).remark
    degrees = [[0, 0, -600, 0, 90, -180.5]]
    for harmless in (
        {"rows": degrees},
        {"rows": [[0, 0, -600, 0, 5, -3]]},  # nobody turns by whole radians
        {"notation": "rotation_vector", "rows": radians},
    ):
        assert _robot(**harmless).remark == ""


def test_reading_a_plan_says_that_angles_look_like_radians(caplog):
    plan_from_text(plan_to_toml(_plan(_robot(rows=[[0, 0, 0, 0, 1.5708, 0]]))))
    assert "the measuring plan: poses 'robot': no angle is beyond ±2π" in caplog.text


# -- TOML and YAML ------------------------------------------------------------------------------

POSES = """
[[poses]]
name = "robot"
notation = "matrix"
frame = "camera_from_part"
rows = [
    [[1, 0, 0, 20], [0, 1, 0, -35], [0, 0, 1, 640], [0, 0, 0, 1]],
    [[0, -1, 0, 20], [1, 0, 0, -35], [0, 0, 1, 600]],
]
exposures_ms = { first = 5, last = 20, count = 3 }
"""
FIXED = """
[[fixed]]
name = "overview"
camera_from_part = [[1, 0, 0, 20], [0, 1, 0, -35], [0, 0, 1, 640], [0, 0, 0, 1]]
exposures_ms = [40]
"""


def test_matrices_are_written_row_by_row():
    plan = plan_from_text(HEAD + POSES)
    (first, second) = plan.poses[0].views(CAMERA_FROM_TCP)
    assert first[1] == RigidTransform(translation_mm=np.array([20.0, -35.0, 640.0]))
    assert second[1].to_fanuc_wpr() == pytest.approx((0, 0, 90))
    assert plan.poses[0].exposures_ms == (5, 10, 20)
    text = plan_to_toml(plan)
    assert "    [[0, -1, 0, 20], [1, 0, 0, -35], [0, 0, 1, 600]],\n]" in text
    assert plan_from_text(text) == plan


def test_a_fixed_view_is_a_list_of_one_pose():
    fixed = plan_from_text(HEAD.replace("version = 3", "version = 2") + FIXED)
    row = [1, 0, 0, 20, 0, 1, 0, -35, 0, 0, 1, 640, 0, 0, 0, 1]
    assert fixed.poses == (
        PoseList(
            name="overview",
            notation="matrix",
            frame="camera_from_part",
            rows=[row],
            exposures_ms=[40],
        ),
    )
    assert [name for name, *_ in fixed.poses[0].views(CAMERA_FROM_TCP)] == ["overview"]
    assert FIXED in plan_to_toml(fixed)
    assert "version = 2\n" in plan_to_toml(fixed)
    both = plan_from_text(HEAD + FIXED + POSES)
    assert [poses.name for poses in both.poses] == ["robot", "overview"]
    assert plan_from_text(plan_to_toml(both)) == both
    assert "version = 3\n" in plan_to_toml(both)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0, 1, 0, -35]", "[0, 1, 0]", "poses 'robot', row 1: .*12 or 16 numbers .*got 15"),
        ("[0, -1, 0, 20]", "[0, -1.1, 0, 20]", "row 2: not a rotation"),
        ("[0, -1, 0, 20]", '[0, "a", 0, 20]', r"poses\[0\]\.rows\[1\]\[1\]': expected a number"),
        ('"matrix"', '"matrx"', r"poses\[0\]\.notation': expected 'fanuc', .*got \"matrx\""),
        ("frame", "frames", r"poses\[0\]\.frame' is missing; .*frames' is unknown"),
        (
            "exposures_ms =",
            "file = 'p.csv'\nexposures_ms =",
            "give rows or file, not both",
        ),
    ],
)
def test_a_wrong_list_in_a_file_says_what_is_wrong(old, new, message):
    assert old in POSES
    with pytest.raises(FormatError, match=message):
        plan_from_text(HEAD + POSES.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0, 1, 0, -35]", "[0, 1, 0]", r"fixed\[0\]\.camera_from_part\[1\]"),
        ("name", "nam", r"fixed\[0\]\.name' is missing"),
        ("[[fixed]]", "[fixed]", "'fixed': expected a list"),
    ],
)
def test_a_wrong_fixed_view_is_named_as_it_stands(old, new, message):
    with pytest.raises(FormatError, match=message):
        plan_from_text(HEAD + FIXED.replace(old, new))


# -- CSV ----------------------------------------------------------------------------------------

CSV = """x_mm,y_mm,z_mm,w_deg,p_deg,r_deg,name,exposures_ms
0,0,-600,0,0,0,start,

20,15,-640,5,-10.5,90,end,7 30
"""


def _read_csv(folder, text, key=""):
    (folder / "poses.csv").write_text(text, "utf-8")
    entry = f"""
[[poses]]
name = "robot"
frame = "part_from_tcp"
file = "poses.csv"
exposures_ms = [40]
{key}
"""
    return plan_from_text(HEAD + entry, folder=folder)


def test_a_list_may_stand_in_a_csv_file(tmp_path):
    plan = _read_csv(tmp_path, CSV)
    expected = _robot(
        frame="part_from_tcp",
        rows=[[0, 0, -600, 0, 0, 0], [20, 15, -640, 5, -10.5, 90]],
        names=["start", "end"],
        exposures_each_ms=[[40], [7, 30]],
    )
    assert plan.poses == (expected,)
    assert plan_from_text(plan_to_toml(plan)) == plan  # needs the file no more


def test_columns_may_stand_in_any_order_and_say_the_notation(tmp_path):
    pose = RigidTransform.from_fanuc_wpr((1.0, 2.0, -600.0), 5.0, -10.0, 90.0)
    for notation in get_args(PoseNotation):
        columns, numbers = pose_columns(notation), map(repr, map(float, _numbers(notation, pose)))
        cells = dict(zip(columns, numbers, strict=True))
        header = sorted(columns)
        text = f"{','.join(header)}\n{','.join(cells[column] for column in header)}\n"
        (poses,) = _read_csv(tmp_path, text).poses
        assert {*pose_columns(poses.notation)} == {*columns}
        ((_, _, tcp_from_part, times_ms),) = poses.views(CAMERA_FROM_TCP)
        assert tcp_from_part.inverse().to_matrix() == pytest.approx(pose.to_matrix(), abs=ROUNDING)
        assert times_ms == (40.0,)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("w_deg", "w_rad", r"poses\.csv, line 2: w, p, r are in different units"),
        ("x_mm", "x_m", "x, y and z are in different units: m, mm"),
        ("exposures_ms", "exposure", "go into a column exposures_ms, got exposure"),
        ("r_deg", "p_deg", "expected the columns of a fanuc pose"),
        ("20,15", "20", r"poses\.csv: expected 8 cells .* line 4 has 7"),
        ("20,15", "20,here", r"line 4, y_mm: 'here'"),
        ("20,15", "20,inf", r"line 4, column y_mm: expected a finite number"),
        ("7 30", "7 x", r"line 4, column exposures_ms: expected a number, got 'x'"),
        ("7 30", "7 -3", r"exposures_ms must all be above 0"),
        ("start", "end", "two poses are called 'end'"),
        (CSV, "x_mm,y_mm,z_mm,w_deg,p_deg,r_deg", "poses 'robot': rows is empty"),
        (CSV, "x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,0,0,1,1,0,0", r"poses\.csv, line 2: .*norm 1"),
    ],
)
def test_a_wrong_csv_file_says_what_is_wrong(tmp_path, old, new, message):
    assert old in CSV
    with pytest.raises(FormatError, match=message):
        _read_csv(tmp_path, CSV.replace(old, new))


def test_a_notation_that_the_header_contradicts_is_refused(tmp_path):
    with pytest.raises(FormatError, match=r"expected the columns of a kuka pose, .*a_deg"):
        _read_csv(tmp_path, CSV, 'notation = "kuka"')
    with pytest.raises(FormatError, match="did you mean 'kuka'"):
        _read_csv(tmp_path, CSV, 'notation = "kukka"')


def test_a_missing_csv_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"list of poses in CSV.*poses\.csv"):
        plan_from_text(
            HEAD + '[[poses]]\nname = "a"\nframe = "part_from_tcp"\nfile = "poses.csv"',
            folder=tmp_path,
        )


@pytest.mark.parametrize(
    "text",
    [
        CSV.replace(",", ";").replace("10.5", "10,5"),
        CSV.replace("x_mm", "X").replace("y_mm", "Y [mm]").replace("name", "view"),
    ],
)
def test_a_table_may_be_in_another_dialect(tmp_path, text):
    expected = _read_csv(tmp_path, CSV).poses[0]
    (poses,) = _read_csv(tmp_path, text).poses
    views, others = (list(each.views(CAMERA_FROM_TCP)) for each in (poses, expected))
    assert [(v[0], v[3]) for v in views] == [(v[0], v[3]) for v in others]
    for (_, pose, *_), (_, other, *_) in zip(views, others, strict=True):
        assert pose.to_matrix() == pytest.approx(other.to_matrix(), abs=1e-9)


def test_a_robots_program_and_the_chain_make_a_list(tmp_path):
    flange = RigidTransform.from_kuka_abc((900, -250, 1100), 30, 12, 171)
    hand_eye = RigidTransform.from_fanuc_wpr((40, -75, 120), 3, -5, 88)
    part = RigidTransform.from_fanuc_wpr((4, -3, 500), 180, 8, 0)
    np.savetxt(tmp_path / "hand_eye.txt", hand_eye.to_matrix())
    np.savetxt(tmp_path / "part.txt", (flange @ hand_eye @ part).to_matrix())
    x, y, z = flange.translation_mm
    numbers = f"{{X {x},Y {y},Z {z},A 30.0,B 12.0,C 171.0,S 2,T 1}}"
    (tmp_path / "door.dat").write_text(f"DECL E6POS XP1={numbers}\nDECL E6POS XP2={numbers}\n")
    entry = """
[[poses]]
name = "robot"
frame = "base_from_flange"
file = "door.dat"
hand_eye = "hand_eye.txt"
part_in_base = "part.txt"
exposures_ms = [40]
"""
    (poses,) = plan_from_text(HEAD + entry, folder=tmp_path).poses
    views = list(poses.views(CAMERA_FROM_TCP))
    assert [view[0] for view in views] == ["XP1", "XP2"]
    assert views[1][1].to_matrix() == pytest.approx(part.to_matrix(), abs=1e-6)
    with pytest.raises(FormatError, match="needs part_in_base"):
        plan_from_text(HEAD + entry.replace('part_in_base = "part.txt"', ""), folder=tmp_path)
    with pytest.raises(FormatError, match='go with frame = "base_from_flange"'):
        plan_from_text(
            HEAD + entry.replace("base_from_flange", "camera_from_part"), folder=tmp_path
        )

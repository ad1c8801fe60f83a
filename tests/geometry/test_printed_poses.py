import contextlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import AmbiguousError, FormatError, InputError, MissingFileError, PoseError
from exposight.files import Reading, collected_remarks, reading_as
from exposight.geometry import RigidTransform, parse_pose, read_named_poses, read_pose

POSE = RigidTransform.from_fanuc_wpr((12.5, -3.0, 600.0), 10.0, -20.0, 30.0)
M = POSE.to_matrix()
X, Y, Z = POSE.translation_mm
A, B, C = POSE.to_kuka_abc()
Q = POSE.to_abb_quaternion()
M_PER_S, VECTOR = POSE.to_ur_rotation_vector()
QUATERNION = ",".join(f"{q:.9f}" for q in Q)
UR = [*M_PER_S, *VECTOR]
ROS = {
    "position": dict(zip("xyz", M_PER_S.tolist(), strict=True)),
    "orientation": dict(zip("wxyz", Q.tolist(), strict=True)),
}
EXTRA = "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]"

PRINTED = {
    "KUKA frame": f"{{X {X},Y {Y},Z {Z},A {A:.6f},B {B:.6f},C {C:.6f}}}",
    "KUKA position": f"{{E6POS: X {X}, Y {Y}, Z {Z}, A {A:.6f}, B {B:.6f}, C {C:.6f}, S 2}}",
    "KUKA declaration": f"DECL E6POS XP1={{X {X},Y {Y},Z {Z},A {A:.6f},B {B:.6f},C {C:.6f},S 6}}",
    "KUKA decimal commas": f"{{X {X}, Y {Y}, Z {Z}, A {A:.6f}, B {B:.6f}, C {C:.6f}}}".replace(
        ".", ","
    ),
    "ABB robtarget": f"[[{X},{Y},{Z}],[{QUATERNION}],[0,0,-1,0],{EXTRA}]",
    "ABB declaration": f"CONST robtarget p10:=[[{X},{Y},{Z}],[{QUATERNION}],[0,0,0,0],{EXTRA}];",
    "ABB pose": f"PERS pose there := [ [{X}, {Y}, {Z}], [{QUATERNION}] ];",
    "UR": f"p[{','.join(f'{n:.9f}' for n in UR)}]",
    "UR script": f"  Waypoint_1_p = p[{', '.join(f'{n:.9f}' for n in UR)}]\n",
    "UR decimal commas": f"p[{', '.join(f'{n:.9f}'.replace('.', ',') for n in UR)}]",
    "UR tight decimal commas": f"p[{','.join(f'{n:.9f}'.replace('.', ',') for n in UR)}]",
    "Fanuc program": (
        "/POS\nP[1]{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX =   {X}  mm,\tY =   {Y}  mm,\tZ =   {Z}  mm,\n"
        "\tW =   10.0 deg,\tP =   -20.0 deg,\tR =   30.0 deg\n};\n/END\n"
    ),
    "Fanuc pendant": f"X: {X} Y: {Y} Z: {Z}\nW: 10.0 P: -20.0 R: 30.0",
    "HALCON": (
        "# 3D POSE PARAMETERS: rotation and translation\n\nf 2\n\nr 10 -20 30\n\n"
        f"# Translation vector (x y z [m]):\nt {X / 1000} {Y / 1000} {Z / 1000}\n"
    ),
    "Zivid": "__version__:\n  serializer: 1\n  data: 12\nFloatMatrix:\n  Data:\n    "
    + json.dumps(M.tolist()),
    "Zivid block": "FloatMatrix:\n  Data:\n"
    + "".join("  - [" + ", ".join(f"{n:.9g}" for n in row) + "]\n" for row in M.tolist()),
    "numpy": repr(M),
    "numpy print": str(M),
    "python": str(M.tolist()),
    "rows": "\n".join(" ".join(f"{n:.9f}" for n in row) for row in M),
    "three rows": "\n".join(";".join(f"{n:.9f}" for n in row) for row in M[:3]),
    "German rows": "\n".join(";".join(f"{n:.9f}".replace(".", ",") for n in r) for r in M),
    "transposed": "\n".join(" ".join(f"{n:.9f}" for n in row) for row in M.T),
    "ROS JSON": json.dumps(ROS),
    "ROS message": (
        "header:\n  frame_id: base\npose:\n  position:\n"
        + "".join(f"    {k}: {v}\n" for k, v in ROS["position"].items())
        + "  orientation:\n"
        + "".join(f"    {k}: {v}\n" for k, v in ROS["orientation"].items())
        + "---\n"
    ),
    "trajectory": "# timestamp tx ty tz qx qy qz qw\n1305031102.1758 "
    + " ".join(f"{n:.9f}" for n in [*M_PER_S, *np.roll(Q, -1)]),
    "named": json.dumps({"x_mm": X, "y_mm": Y, "z_mm": Z, "a": A, "b": B, "c": C}),
    "TF": "transforms:\n- child_frame_id: part\n  transform:\n"
    f"    translation: {{x: {M_PER_S[0]}, y: {M_PER_S[1]}, z: {M_PER_S[2]}}}\n"
    f"    rotation: {{x: {Q[1]}, y: {Q[2]}, z: {Q[3]}, w: {Q[0]}}}\n",
    "keys and values": f"x_mm={X}, y_mm={Y}, z_mm={Z}, w=10.0, p=-20.0, r=30.0",
    "OpenCV hand-eye": "%YAML:1.0\n---\nR_cam2gripper: !!opencv-matrix\n   rows: 3\n   cols: 3\n"
    f"   dt: d\n   data: {M[:3, :3].ravel().tolist()}\nt_cam2gripper: !!opencv-matrix\n   rows: 3\n"
    f"   cols: 1\n   dt: d\n   data: {M[:3, 3].tolist()}\n",
    "OpenCV": "%YAML:1.0\n---\nT: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: "
    + str(M.ravel().tolist()),
}


@pytest.mark.parametrize("form", PRINTED)
def test_a_pose_is_read_as_it_is_printed(form):
    assert parse_pose(None, PRINTED[form]).to_matrix() == pytest.approx(M, abs=2e-5)


@pytest.mark.parametrize("form", [f for f in PRINTED if f != "trajectory"])
def test_and_from_a_file(tmp_path, form):
    path = tmp_path / "pose.dat"
    path.write_text(PRINTED[form], encoding="utf-16" if "German" in form else "utf-8")
    with collected_remarks() as remarks:
        assert read_pose(path).to_matrix() == pytest.approx(M, abs=2e-5)
    plain = {"numpy", "numpy print", "python", "rows", "German rows"}
    assert bool(remarks) == (form not in plain)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,2,3,4,5,6", "which robot"),
        ("[1, 2, 3, 4, 5, 6]", "which robot"),
        ('{"pose": [1, 2, 3, 4, 5, 6]}', "which robot"),
        (f"12.5 -3 600 {QUATERNION}", "--read-as quaternion=wxyz"),
        (f"[[12.5,-3,600],[{QUATERNION}]]", "--read-as quaternion=wxyz"),
        ("0.1 0.2 0.5 10 20 30 0", "HALCON"),
        ("p[12.5,-3,600,0,0,1]", "unit=mm"),
        ("X: 1 Y: 2 Z: 300 RX: 10 RY: 20 RZ: 30", "rotation vector"),
        ("{X 1,234,Y 2,500,Z 3,125,A 1,111,B 2,222,C 3,333}", "--read-as decimal=comma"),
        (json.dumps({"translation": [1, 2, 300], "rotation": Q.tolist()}), "quaternion=wxyz"),
        (json.dumps({"x": 0.1, "y": 0.2, "z": 0.5, "qw": 1, "qx": 0, "qy": 0, "qz": 0}), "unit=m"),
    ],
)
def test_what_two_readings_fit_is_asked_for(text, said):
    with pytest.raises(AmbiguousError, match=said) as raised:
        parse_pose(None, text)
    assert raised.value.readings


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}", "joint angles"),
        ("{X 1,Y 2,Z 3}", "needs X, Y, Z, A, B and C"),
        ("f 9\nr 1 2 3\nt 0.1 0.2 0.3\n", r"type 9 \('R\(p-T\)', 'gba', 'coordinate_system'\)"),
        ("P[1]{ GP1: UF : 0, UT : 1, J1= 0.0 deg, J2= 1.0 deg };", "Cartesian"),
        ("p[0.1,0.2,0.3]", "of Universal Robots holds"),
        ("p[0.1,0.2,0.3,180,0,0]", "by more than 2π"),
        ("hello", "no pose in it"),
        ("1 2 3", "16 numbers.* got 3 numbers"),
        ("2 0 0 1\n0 2 0 1\n0 0 2 1\n0 0 0 1", "not a rotation"),
        (f"[[1,2,3],[0.5,0.5,0.5,0.6],[0,0,0,0],{EXTRA}]", "norm 1"),
    ],
)
def test_what_is_no_pose_is_refused_with_what_is_wrong(text, said):
    with pytest.raises(PoseError, match=said):
        parse_pose(None, text)


def test_answers_are_taken():
    numbers = f"12.5 -3 600 {QUATERNION.replace(',', ' ')}"
    with reading_as(Reading(quaternion="wxyz")):
        assert parse_pose(None, numbers).to_matrix() == pytest.approx(M, abs=1e-6)
    with reading_as(Reading(unit="mm")):
        vector = ",".join(map(str, VECTOR))
        assert parse_pose("ur", f"{X},{Y},{Z},{vector}").to_matrix() == pytest.approx(M)
    with reading_as(Reading(angle="rad")):
        angles = ",".join(map(str, np.radians([10, -20, 30])))
        assert parse_pose("fanuc", f"{X},{Y},{Z},{angles}").to_matrix() == pytest.approx(M)


def test_a_known_notation_takes_its_own_form_and_no_other():
    assert parse_pose("kuka", PRINTED["KUKA frame"]).to_matrix() == pytest.approx(M, abs=1e-6)
    assert parse_pose("abb", f"[[{X},{Y},{Z}],[{QUATERNION}]]").to_matrix() == pytest.approx(M)
    with pytest.raises(PoseError, match="expected a kuka pose, got a Universal Robots pose"):
        parse_pose("kuka", PRINTED["UR"])


def test_angles_that_look_like_radians_are_remarked():
    with collected_remarks() as remarks:
        parse_pose("fanuc", "1,2,600,0.5,-1.25,3.1")
    assert any("±2π" in remark for remark in remarks)


def test_a_program_has_its_positions_by_name(tmp_path):
    program = tmp_path / "DOOR.LS"
    lines = [
        f"P[{n}{note}]{{\n GP1:\n UF : 1, UT : 2, CONFIG : 'N U T, 0, 0, 0',\n"
        f" X = {n}.5 mm, Y = -.25 mm,"
        " Z = 600 mm,\n W = 10 deg, P = -20 deg, R = 30 deg\n GP2:\n UF : 1, UT : 1,\n J1= 5 mm\n};"
        for n, note in ((1, ""), (3, ':"approach"'))
    ]
    program.write_text("/PROG DOOR\n/MN\n 1:J P[1] 100% FINE ;\n/POS\n" + "\n".join(lines))
    poses = read_named_poses(program)
    assert list(poses) == ["P[1]", "P[3]"]
    assert poses["P[3]"].translation_mm.tolist() == [3.5, -0.25, 600.0]
    with pytest.raises(PoseError, match=r"2 poses: P\[1\], P\[3\]; say which one.*DOOR.LS#P\[1\]"):
        read_pose(program)
    assert read_pose(f"{program}#P[3]") == poses["P[3]"]
    with pytest.raises(PoseError, match=r"no pose is called 'P\[2\]'"):
        read_pose(f"{program}#P[2]")


def test_other_programs_have_theirs(tmp_path):
    dat = tmp_path / "a.dat"
    dat.write_text(
        ";FOLD PTP P1 ;%{PE}%R 8.3\nDECL E6POS XP1={X 1,Y 2,Z 3,A 0,B 0,C 0,S 2,T 1,E1 0.0}\n"
        'DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}\n'
        "XHOME = {X 10.0, Y 0.0, Z 600.0, A 180.0, B 0.0, C 90.0}\n"
        "LIN_REL {X 0,Y 0,Z 5,A 0,B 0,C 0}\n"
    )
    assert list(read_named_poses(dat)) == ["XP1", "XHOME"]
    module = tmp_path / "m.mod"
    module.write_text(
        "MODULE M\n! CONST robtarget p0:=[[0,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        "PERS tooldata t1:=[TRUE,[[97.4,0,223.1],[1,0,0,0]],[5,[23,0,75],[1,0,0,0],0,0,0]];\n"
        "CONST robtarget p10:=[[1,2,3],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\nENDMODULE"
    )
    poses = read_named_poses(module)
    assert list(poses) == ["t1", "p10"]
    assert poses["t1"].translation_mm.tolist() == [97.4, 0.0, 223.1]


def test_documents_and_folders_name_their_poses(tmp_path):
    document = tmp_path / "poses.json"
    other = POSE.inverse()
    document.write_text(json.dumps({"a": M.tolist(), "b": {"matrix": other.to_matrix().tolist()}}))
    assert read_named_poses(document) == {"a": POSE, "b": other}
    document.write_text(json.dumps([{"name": "v1", "pose": M.tolist()}, {"name": "v2", **ROS}]))
    poses = read_named_poses(document)
    assert list(poses) == ["v1", "v2"]
    assert poses["v2"].to_matrix() == pytest.approx(M)
    folder = tmp_path / "views"
    folder.mkdir()
    np.savetxt(folder / "P01.txt", M)
    np.save(folder / "P02.npy", other.to_matrix())
    assert list(read_named_poses(folder)) == ["P01", "P02"]
    (folder / "P03.txt").write_text("1 2 3")
    with pytest.raises(PoseError, match=r"1 of 3 files are no poses: .*P03\.txt"):
        read_named_poses(folder)
    document.write_text(json.dumps([{"name": "v", "pose": M.tolist()}] * 2))
    with pytest.raises(PoseError, match="twice: v"):
        read_named_poses(document)
    with pytest.raises(MissingFileError):
        read_named_poses(tmp_path / "nothing.txt")


def test_a_transposed_matrix_is_said_to_be_one(tmp_path):
    np.savetxt(tmp_path / "t.txt", M.T)
    with collected_remarks() as remarks:
        assert read_pose(tmp_path / "t.txt").to_matrix() == pytest.approx(M)
    assert "transposed" in next(iter(remarks))


def test_a_matrix_printed_with_few_decimals_is_made_exact(tmp_path):
    path = tmp_path / "short.txt"
    np.savetxt(path, M, fmt="%.4f")
    read = read_pose(path)
    assert read.rotation == pytest.approx(M[:3, :3], abs=1e-4)
    assert np.abs(read.rotation.T @ read.rotation - np.eye(3)).max() < 1e-12


_MM = st.floats(-3000, 3000).map(lambda n: round(n, 3))
_DEG = st.floats(-180, 180).map(lambda n: round(n, 3))


@settings(deadline=None, max_examples=60)
@given(position=st.tuples(_MM, _MM, st.floats(20, 3000)), angles=st.tuples(_DEG, _DEG, _DEG))
def test_forms_of_one_pose_agree(position, angles):
    pose = RigidTransform.from_fanuc_wpr(position, *angles)
    x, y, z = pose.translation_mm
    a, b, c = pose.to_kuka_abc()
    metres, vector = pose.to_ur_rotation_vector()
    q = pose.to_abb_quaternion()
    for text in (
        f"{{X {x:.9f},Y {y:.9f},Z {z:.9f},A {a:.9f},B {b:.9f},C {c:.9f}}}",
        f"[[{x:.9f},{y:.9f},{z:.9f}],[{','.join(f'{n:.9f}' for n in q)}],[0,0,0,0],{EXTRA}]",
        f"p[{','.join(f'{n:.12f}' for n in [*metres, *vector])}]",
        str(pose.to_matrix().tolist()),
        str(pose.to_matrix().T.tolist()),
    ):
        assert parse_pose(None, text).to_matrix() == pytest.approx(pose.to_matrix(), abs=1e-5)


@settings(deadline=None, max_examples=80)
@given(text=st.text(alphabet="XYZABCWPRp[]{}=:,;. -0123456789\n\"'", max_size=80))
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(InputError):
        assert np.isfinite(parse_pose(None, text).to_matrix()).all()


@pytest.mark.parametrize(
    "text",
    [
        f"name,x_mm,y_mm,z_mm,w,p,r\nv1,{X},{Y},{Z},10,-20,30\nv2,{X},{Y},{Z},10,-20,30\n",
        "Punkt;X [mm];Y [mm];Z [mm];A;B;C\n"
        + "".join(f"v{i};{X};{Y};{Z};{A:.6f};{B:.6f};{C:.6f}\n".replace(".", ",") for i in (1, 2)),
        "view\tqw\tqx\tqy\tqz\ttx_m\tty_m\ttz_m\n"
        + "".join(f"v{i}\t" + "\t".join(f"{n:.9f}" for n in [*Q, *M_PER_S]) + "\n" for i in (1, 2)),
        "name,"
        + ",".join(
            f"r{i}{j}" if j < 4 else f"{'xyz'[i - 1]}_mm" for i in (1, 2, 3) for j in (1, 2, 3, 4)
        )
        + "\n"
        + "".join(f"v{i}," + ",".join(map(str, M[:3].ravel())) + "\n" for i in (1, 2)),
    ],
)
def test_tables_have_a_pose_a_row(tmp_path, text):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    poses = read_named_poses(path)
    assert list(poses) == ["v1", "v2"]
    for pose in poses.values():
        assert pose.to_matrix() == pytest.approx(M, abs=2e-5)


def test_faults_of_a_table_come_all_at_once(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(
        "name,x,y,z,qw,qx,qy,qz\na,1,2,300,1,0,0,0\nb,1,2,300,2,0,0,0\nc,1,2,300,1,0,0,\n"
    )
    with pytest.raises(FormatError, match=r"2 of 3 rows.*line 3.*norm 1.*line 4: qz is empty"):
        read_named_poses(path)
    path.write_text("name,x,y,z,rx,ry,rz\na,1,2,300,1,0,0\n")
    with pytest.raises(AmbiguousError, match="rotation vector"):
        read_named_poses(path)


BOMB = "a: &a [1, 1, 1]\n" + "".join(
    f"{new}: &{new} [*{old}, *{old}, *{old}, *{old}]\n"
    for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (BOMB, "an alias"),
        ("a: 1\nb: {<<: {x: 2}}\n", "a merge key"),
        ("a: " + "[" * 100_000, "nested more than 30"),
        ("".join(f"k{i}: {i}\n" for i in range(101_000)), "more than 200000"),
        ("a:\n  t: [1, 2, 300]\n  t: [1, 2, 400]\n", "'t' is there twice"),
        ('{"a": {"t": [1, 2, 300], "t": [1, 2, 400]}}', "'t' is there twice"),
        ("{X 1,Y 2,Z 3,X 4,A 0,B 0,C 0}", "X twice"),
        ("{X 1e300,Y 2,Z 3,A 0,B 0,C 0}", "within a kilometre"),
        ("{X 1,Y 2,Z 3,A 1e300,B 0,C 0}", "an angle of 1e"),
    ],
)
def test_hostile_poses_are_refused(tmp_path, text, reason):
    path = tmp_path / "pose.yaml"
    path.write_text(text)
    with pytest.raises(PoseError, match=reason):
        read_named_poses(path)


@pytest.mark.parametrize(
    "text",
    [
        '{"poses": [{"pose": [[1,0,0,5],[0,1,0,6],[0,0,1,7],[0,0,0,1]]},'
        ' {"pose": [[1,0,0],[0,1,0,6],[0,0,1,7],[0,0,0,1]]}]}',
        '{"a": {"position": [100,200,300], "rotation_vector": [0,0,0.5]},'
        ' "b": {"position": [100,200,300], "rotation_vector": [0,"x",0.5]}}',
        "CONST robtarget a:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        "CONST robtarget b:=[[1,2],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];",
        "XP1={X 1,Y 2,Z 3,A 4,B 5,C 6}\nXP2={X 1,Y 2,Z 3,A 4,B 5}",
        "P[1]{\n GP1:\n X = 1 mm, Y = 2 mm, Z = 3 mm,\n W = 4 deg, P = 5 deg, R = 6 deg\n};\n"
        "P[2]{\n GP1:\n X = 1 mm, Y = 2 mm, Z = 3 mm,\n W = 4 deg, P = 5 deg\n};",
    ],
)
def test_one_damaged_pose_among_others_is_not_left_out(tmp_path, text):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(PoseError):
        read_named_poses(path)

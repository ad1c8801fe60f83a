"""Calibrations as OpenCV and ROS write them."""

import cv2
import numpy as np
import pytest

from exposight.errors import AmbiguousError, FormatError, MissingFileError, PoseError
from exposight.geometry import (
    CalibrationKeys,
    PinholeCamera,
    ProjectorCamera,
    RigidTransform,
    read_calibration_nodes,
    read_projector_camera,
    read_ros_camera_info,
)

CAMERA = PinholeCamera(
    width=640, height=480, fx=600.5, fy=601.25, cx=320, cy=241, distortion=(0.1, -0.2, 0, 0, 0)
)
PROJECTOR = PinholeCamera(
    width=1024, height=768, fx=1500, fy=1501, cx=512, cy=700, distortion=(0.01, 0, 0.002, 0)
)
PROJECTOR_FROM_CAMERA = RigidTransform.from_fanuc_wpr([120.0, -8.5, 33.0], 1.0, -14.0, 2.0)

SLSTUDIO = {
    "Kc": CAMERA.matrix,
    "kc": np.array(CAMERA.distortion),
    "Kp": PROJECTOR.matrix,
    "kp": np.array(PROJECTOR.distortion),
    "Rp": PROJECTOR_FROM_CAMERA.rotation,
    "Tp": PROJECTOR_FROM_CAMERA.translation_mm,
    "cam_error": 0.28,
    "frameWidth": 640,
    "frameHeight": 480,
    "screenResX": 1024,
    "screenResY": 768,
}

SIZE_PAIR = {
    "img_shape": np.array([480.0, 640.0]),  # height first
    "cam_int": CAMERA.matrix,
    "cam_dist": np.array(CAMERA.distortion),
    "proj_int": PROJECTOR.matrix,
    "proj_dist": np.array(PROJECTOR.distortion),
    "roration": PROJECTOR_FROM_CAMERA.rotation,
    "translation": PROJECTOR_FROM_CAMERA.translation_mm,
}


def written(path, nodes):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in nodes.items():
        storage.write(key, value)
    storage.release()
    return path


def assert_as_written(calibration):
    assert calibration.camera == CAMERA
    assert calibration.projector == PROJECTOR
    pose = calibration.projector_from_camera
    np.testing.assert_allclose(pose.rotation, PROJECTOR_FROM_CAMERA.rotation, atol=1e-14)
    np.testing.assert_array_equal(pose.translation_mm, PROJECTOR_FROM_CAMERA.translation_mm)


# -- OpenCV -------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["yml", "xml", "json"])
def test_reads_what_opencv_writes(tmp_path, ending):
    path = written(tmp_path / f"calibration.{ending}", SLSTUDIO)
    assert_as_written(read_projector_camera(path))


def test_reads_yaml_without_its_first_line(tmp_path):
    path = written(tmp_path / "calibration.yml", SLSTUDIO)
    first, rest = path.read_text().split("\n", 1)
    assert first.startswith("%YAML")
    path.write_text(rest)
    assert_as_written(read_projector_camera(path))


@pytest.mark.parametrize("spoiled", ["\ufeff{}", "\n\n{}", "{}\n\n"])
def test_a_byte_order_mark_or_blank_lines_do_not_matter(tmp_path, spoiled):
    path = written(tmp_path / "calibration.yml", SLSTUDIO)
    path.write_text(spoiled.replace("{}", path.read_text()), encoding="utf-8")
    assert_as_written(read_projector_camera(path))


def test_windows_line_ends_do_not_matter(tmp_path):
    path = written(tmp_path / "calibration.yml", SLSTUDIO)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert_as_written(read_projector_camera(path))


def test_a_projector_given_by_its_pose_comes_back_from_its_file(tmp_path):
    pose = PROJECTOR_FROM_CAMERA.inverse()
    path = tmp_path / "calibration.yml"
    rig = ProjectorCamera(
        camera=CAMERA, projector=PROJECTOR, projector_from_camera=PROJECTOR_FROM_CAMERA
    )
    path.write_text(rig.to_slstudio())
    calibration = read_projector_camera(path)
    assert (calibration.camera, calibration.projector.fx) == (CAMERA, PROJECTOR.fx)
    # the projector stands where its pose says, and its optical centre is its frame's origin
    again = calibration.camera_from_projector
    np.testing.assert_allclose(again.translation_mm, pose.translation_mm, atol=1e-10)
    centre = calibration.projector_from_camera.apply(pose.translation_mm)
    np.testing.assert_allclose(centre, np.zeros(3), atol=1e-10)


def test_single_precision_is_read(tmp_path):
    nodes = {key: np.float32(v) if np.ndim(v) else v for key, v in SLSTUDIO.items()}
    calibration = read_projector_camera(written(tmp_path / "calibration.xml", nodes))
    np.testing.assert_allclose(calibration.camera.matrix, CAMERA.matrix, rtol=1e-6)


def test_a_node_of_two_numbers_is_height_then_width(tmp_path):
    path = written(tmp_path / "calibration.xml", SIZE_PAIR)
    assert_as_written(read_projector_camera(path, projector_size=(1024, 768)))


def test_the_caller_may_name_the_nodes(tmp_path):
    renamed = {f"my_{key}": value for key, value in SLSTUDIO.items()}
    keys = CalibrationKeys(
        camera_matrix="my_Kc",
        camera_distortion="my_kc",
        projector_matrix="my_Kp",
        projector_distortion="my_kp",
        rotation="my_Rp",
        translation="my_Tp",
        camera_size="my_frameWidth+my_frameHeight",
        projector_size="my_screenResX+my_screenResY",
    )
    assert_as_written(read_projector_camera(written(tmp_path / "c.yml", renamed), keys))


def test_maps_become_dotted_names_and_text_stays_text(tmp_path):
    path = tmp_path / "settings.yml"
    path.write_text('%YAML:1.0\n---\nouter: { inner: { a: 2 } }\nname: "left"\nlist: [1, 2.5]\n')
    file = read_calibration_nodes(path)
    assert file.whole_numbers("outer.inner.a", 1) == [2]
    assert file.nodes["name"] == "left"
    np.testing.assert_array_equal(file.matrix("list", (2,)), [1, 2.5])


# -- recordings ---------------------------------------------------------------------------------


def test_reads_the_skulls_calibration(real_data):
    calibration = read_projector_camera(real_data / "skull" / "calibration.xml")
    camera, projector = calibration.camera, calibration.projector
    assert (camera.width, camera.height) == (1688, 1352)
    assert (projector.width, projector.height) == (1824, 1140)
    assert camera.fx == pytest.approx(2195.12036)
    assert camera.distortion[0] == pytest.approx(-5.80352657e-02)
    assert projector.cy == pytest.approx(1109.11121)
    baseline_mm = np.linalg.norm(calibration.projector_from_camera.translation_mm)
    assert baseline_mm == pytest.approx(164.5, abs=0.1)


def test_reads_the_boards_calibration(real_data):
    path = real_data / "board" / "calibration_result.xml"
    calibration = read_projector_camera(path, projector_size=(1024, 768))
    assert (calibration.camera.width, calibration.camera.height) == (1280, 1024)
    assert calibration.projector.fx == pytest.approx(3953.6715586677710)
    assert len(calibration.camera.distortion) == 5


def test_the_board_does_not_say_how_large_its_projector_is(real_data):
    with pytest.raises(FormatError, match=r"projector's size is not in the file; give its"):
        read_projector_camera(real_data / "board" / "calibration_result.xml")


def test_a_file_without_a_calibration_says_what_it_holds(real_data):
    path = real_data / "foam" / "object1" / "config.xml"
    with pytest.raises(FormatError, match=r"no camera matrix.* has disp_width, disp_height, step"):
        read_projector_camera(path)


# -- ROS ----------------------------------------------------------------------------------------

CALIBRATED = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [600.5, 0.0, 320.0, 0.0, 601.25,
         241.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.0, 0.0, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
"""

ROS_1_MESSAGE = """\
header:
  seq: 0
  stamp:
    secs: 1700000000
    nsecs: 25
  frame_id: "left"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [0.1, -0.2, 0.0, 0.0, 0.0]
K: [600.5, 0.0, 320.0, 0.0, 601.25, 241.0, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
binning_x: 0
roi:
  x_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
"""

ROS_2_MESSAGE = """\
header:
  stamp:
    sec: 1700000000
    nanosec: 25
  frame_id: ''
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.1
- -0.2
- 0.0
- 0.0
- 0.0
k:
- 600.5
- 0.0
- 320.0
- 0.0
- 601.25
- 241.0
- 0.0
- 0.0
- 1.0
roi:
  x_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""

FORMS = {
    "calibration": CALIBRATED,
    "calibration, marked as a document": "---\n" + CALIBRATED,
    "calibration, commented": "# left camera\n" + CALIBRATED,
    "message": ROS_1_MESSAGE,
    "stream of messages": 3 * ROS_1_MESSAGE,
    "message with lists in lines": ROS_2_MESSAGE,
    "message without its end": ROS_2_MESSAGE.removesuffix("---\n"),
}


def ros_file(tmp_path, text):
    path = tmp_path / "camera_info.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("text", FORMS.values(), ids=FORMS.keys())
def test_reads_every_form_of_camera_info(tmp_path, text):
    assert read_ros_camera_info(ros_file(tmp_path, text)) == CAMERA


def test_an_empty_list_is_no_distortion(tmp_path):
    text = ROS_1_MESSAGE.replace("[0.1, -0.2, 0.0, 0.0, 0.0]", "[]").replace("plumb_bob", "")
    assert read_ros_camera_info(ros_file(tmp_path, text)).distortion == ()


def test_eight_coefficients_are_the_rational_model(tmp_path):
    text = ROS_1_MESSAGE.replace("plumb_bob", "rational_polynomial")
    text = text.replace("0.0, 0.0, 0.0]\nK", "0.0, 0.0, 0.0, 1.0, 2.0, 3.0]\nK")
    camera = read_ros_camera_info(ros_file(tmp_path, text))
    assert camera.distortion == (0.1, -0.2, 0, 0, 0, 1, 2, 3)


@pytest.mark.parametrize("model", ["equidistant", "fisheye"])
def test_a_fisheye_lens_is_refused(tmp_path, model):
    path = ros_file(tmp_path, CALIBRATED.replace("plumb_bob", model))
    with pytest.raises(FormatError, match=f"'{model}' is not a pinhole lens's; .*'plumb_bob' or"):
        read_ros_camera_info(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("width", "breadth", r"no key 'image_width' or 'width'; the file has .*breadth"),
        ("K: ", "KK: ", r"no key 'camera_matrix' or 'K' or 'k'; the file has .*KK"),
        ("D: ", "E: ", r"no key 'distortion_coefficients' or 'D' or 'd'; the file has .*E"),
        (", 601.25", "", r"node 'K' must be 3×3 or 9 numbers, got shape \(8,\)"),
        ("601.25", "wide", "node 'K' must be numbers, got the text 'a list with more"),
        ("width: 640", "width: 640.5", r"node 'width' must be whole, got 640\.5"),
        ("width: 640", "width: .nan", "node 'width' must be whole, got nan"),
        ("width: 640", "width: many", "node 'width' must be numbers, got the text 'many'"),
        ("width: 640", "width: [640, 1]", "node 'width' must be one number, got 2"),
        ("width: 640", "width: 0", "an image size must be whole and positive, got 0 × 480 px"),
        ("600.5, 0.0, 320.0, 0.0, 601.25, 241.0, 0.0, 0.0, 1.0", "0, 0, 0, 0, 0, 0, 0, 0, 0",
         "camera matrix must read .* or of an uncalibrated camera"),
        ("[0.1, ", "[", "lens distortion needs 0, 4, 5, .* coefficients|focal"),
    ],
)  # fmt: skip
def test_a_message_with_a_fault_names_the_file_and_the_fault(tmp_path, old, new, message):
    text = ROS_1_MESSAGE.replace(old, new)
    if old == "[0.1, ":
        text = text.replace("[-0.2, 0.0, 0.0, 0.0]", "[-0.2, 0.0, 0.0]")
    with pytest.raises(FormatError, match=f"camera_info.yaml: .*({message})"):
        read_ros_camera_info(ros_file(tmp_path, text))


# -- bad files ----------------------------------------------------------------------------------


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"nowhere\.xml: no such calibration file"):
        read_calibration_nodes(tmp_path / "nowhere.xml")


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(MissingFileError, match="no such calibration file"):
        read_calibration_nodes(tmp_path)


BAD_FILES = {
    "picture": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\xff\xfe",
    "prose": b"The calibration is in the other folder.\nAsk for it.\n",
    "another XML": b'<?xml version="1.0"?>\n<robot><link/></robot>\n',
    "cut XML": b'<?xml version="1.0"?>\n<opencv_storage>\n<Kc type_id="opencv-matrix">\n<rows>3',
    "cut YAML": b"%YAML:1.0\n---\nKc: [1, 2",
    "cut JSON": b'{"Kc": [1, 2',
}


@pytest.mark.parametrize("content", BAD_FILES.values(), ids=BAD_FILES.keys())
def test_what_cannot_be_parsed_is_refused(tmp_path, content):
    path = tmp_path / "calibration"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=r"calibration: (not a calibration|.* no node)"):
        read_calibration_nodes(path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: 1\nProse without a key.\n", "line 2: could not find expected ':'"),
        ('<?xml version="1.0"?>\n<robot/>\n', "its root is <robot>, expected <opencv_storage>"),
        ("<opencv_storage>\n<a>1</b>\n", "line 2: mismatched tag.*"),
        ("a: &x [1, 2]\nb: *x\n", "line 2: an alias.*"),
        ("a: {<<: {b: 1}}\n", "line 1: a merge key.*"),
        ("a: 1\na: 2\n", "the key 'a' is there twice"),
        ("<!DOCTYPE x><opencv_storage/>", "an XML file with a document type.*"),
        ("K: {rows: 3, cols: 3, data: [1, 2]}", "'K' announces 3 × 3 numbers and has 2.*"),
        ("[" * 1000, "(it is nested too|it is nested more|line 1).*"),
    ],
)
def test_the_reason_is_told(tmp_path, text, reason):
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(FormatError, match=rf"\({reason}\); expected a calibration as OpenCV"):
        read_calibration_nodes(path)


EMPTY_XML = '<?xml version="1.0"?><opencv_storage></opencv_storage>'


@pytest.mark.parametrize("text", ["", "\n", EMPTY_XML])
def test_a_file_without_a_node_is_refused(tmp_path, text):
    path = tmp_path / "calibration.yml"
    path.write_text(text)
    with pytest.raises(FormatError, match=r"expected a calibration.* found no node"):
        read_calibration_nodes(path)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("Kc", "Kp is a projector's matrix by its name"),
        ("kc", "no lens distortion is named for Kc.* camera_distortion=none"),
        ("Kp", "expected a camera and a projector, got one camera"),
        ("kp", "no lens distortion is named for Kp.* projector_distortion=none"),
        ("Rp", "no rotation between both devices .*--keys rotation="),
        ("Tp", "no translation between both devices .*--keys translation="),
        ("frameWidth", "the images' size is not in the file.*--keys camera_size="),
        ("screenResY", "the projector's size is not in the file.*--keys projector_size="),
    ],
)
def test_a_calibration_without_a_node_says_which_and_what_to_do(tmp_path, key, message):
    nodes = {name: value for name, value in SLSTUDIO.items() if name != key}
    path = written(tmp_path / "calibration.xml", nodes)
    with pytest.raises((FormatError, AmbiguousError), match=message):
        read_projector_camera(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("Kc", np.eye(2), r"the file has Kc \(2×2\)"),
        ("Kp", PROJECTOR.matrix.T, "'Kp' is a camera matrix transposed"),
        ("kp", np.zeros(3), "0, 4, 5, 8, 12, 14 coefficients in OpenCV's order, got 3"),
        ("Rp", np.zeros((3, 1)), r"no rotation .* Rp \(3×1\)"),
        ("frameWidth", np.eye(2), r"the images' size .* frameWidth \(2×2\)"),
        ("screenResX", "wide", "the projector's size is not in the file"),
    ],
)
def test_a_malformed_node_is_named(tmp_path, key, value, message):
    path = written(tmp_path / "calibration.yml", SLSTUDIO | {key: value})
    with pytest.raises(FormatError, match=f"calibration.yml: .*{message}"):
        read_projector_camera(path)


def test_a_size_of_three_numbers_is_no_size(tmp_path):
    path = written(tmp_path / "calibration.xml", SIZE_PAIR | {"img_shape": np.ones(3)})
    with pytest.raises(FormatError, match=r"the images' size .* img_shape \(3×1\)"):
        read_projector_camera(path, projector_size=(1024, 768))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("Rp", 2 * np.eye(3), "not a rotation"),
        ("Tp", np.array([1.0, np.nan, 3.0]), "a translation in mm needs 3 finite numbers"),
    ],
)
def test_a_pose_that_is_none_names_the_file(tmp_path, key, value, message):
    path = written(tmp_path / "calibration.yml", SLSTUDIO | {key: value})
    with pytest.raises(PoseError, match=f"calibration.yml: .*{message}"):
        read_projector_camera(path)

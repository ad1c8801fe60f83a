"""``exposight sensor``: a calibration and what it does not tell."""

import cv2
import numpy as np
import pytest

from exposight.cell import read_sensor

NEEDED = ("--name", "mine", "--exposures", 1, 500, "--working-distance", 400, 800)

CAMERA_INFO = """image_width: 1280
image_height: 960
camera_matrix:
  rows: 3
  cols: 3
  data: [1100., 0., 640., 0., 1101., 480., 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, 0., 0., 0., 0.]
"""

POSE = "1 0 0 220\n0 1 0 0\n0 0 1 80\n0 0 0 1\n"


def write_calibration(path, baseline=220.0):
    """As procam-calibration writes it: the projector's size is not in it."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in {
        "img_shape": np.array([[960, 1280]]),
        "cam_int": np.array([[1100.0, 0, 640], [0, 1101, 480], [0, 0, 1]]),
        "cam_dist": np.zeros((1, 5)),
        "proj_int": np.array([[900.0, 0, 512], [0, 900, 384], [0, 0, 1]]),
        "proj_dist": np.zeros((1, 5)),
        "roration": np.eye(3),
        "translation": np.array([[-baseline], [0.0], [-80.0 * baseline / 220.0]]),
    }.items():
        storage.write(name, matrix)
    storage.release()
    return path


@pytest.fixture
def camera_info(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA_INFO, encoding="utf-8")
    return path


@pytest.fixture
def failing(run):
    def invoke(*words, status=1):
        result = run("sensor", *words)
        assert result.exit_code == status
        return result.stderr

    return invoke


def test_camera_and_projector(tmp_path, run_json):
    calibration = write_calibration(tmp_path / "c.xml")
    output = tmp_path / "sensor.json"
    size = ("--projector-size", 1024, 768)
    told = run_json("sensor", calibration, *NEEDED, *size, "--exposure-step", 0.5, "-o", output)
    sensor = read_sensor(output)
    assert told["files"][0]["path"] == str(output)
    assert told["exposures_ms"] == [1.0, 500.0, 0.5]
    assert (sensor.name, sensor.camera.fy, sensor.camera.width) == ("mine", 1101.0, 1280)
    assert (sensor.projector.width, sensor.projector.height) == (1024, 768)
    # The file has the projector's frame seen from the camera's the other way round.
    np.testing.assert_allclose(
        sensor.projector.camera_from_projector.translation_mm, [220.0, 0.0, 80.0]
    )


def test_the_tcp_lies_in_the_middle_unless_told(camera_info, tmp_path, run_json):
    for words, middle_mm in (((), 600.0), (("--tcp-distance", 500), 500.0)):
        run_json("sensor", camera_info, *NEEDED, *words, "-o", tmp_path / "s.json")
        tcp = read_sensor(tmp_path / "s.json").camera_from_tcp
        assert tcp.translation_mm.tolist() == [0.0, 0.0, middle_mm]


def test_one_camera_has_no_projector(camera_info, tmp_path, run):
    result = run("sensor", camera_info, *NEEDED, "-o", tmp_path / "s.json")
    assert result.exit_code == 0
    assert read_sensor(tmp_path / "s.json").projector is None


def test_one_camera_and_a_projector_of_its_own(camera_info, tmp_path, run_json):
    pose = tmp_path / "pose.txt"
    pose.write_text(POSE, encoding="utf-8")
    words = ("--projector", camera_info, "--projector-pose", pose, "-o", tmp_path / "s.json")
    run_json("sensor", camera_info, *NEEDED, *words)
    projector = read_sensor(tmp_path / "s.json").projector
    assert projector.camera_from_projector.translation_mm.tolist() == [220.0, 0.0, 80.0]


def test_observe_takes_it(camera_info, tmp_path, run_json):
    run_json("sensor", camera_info, *NEEDED, "-o", tmp_path / "s.json")
    assert run_json("info", tmp_path / "s.json")["kind"] == "sensor"


@pytest.mark.parametrize("option", ["--name", "--exposures", "--working-distance"])
def test_what_a_calibration_lacks_is_asked_for(option, camera_info, failing):
    start = NEEDED.index(option)
    length = 2 if option == "--name" else 3
    words = NEEDED[:start] + NEEDED[start + length :]
    assert f"{option} is missing" in failing(camera_info, *words, status=2)


def test_the_projector_s_size_is_asked_for(tmp_path, failing):
    told = failing(write_calibration(tmp_path / "c.xml"), *NEEDED)
    assert "the projector's size is not in the file; give its width and height" in told


def test_a_calibration_in_metres(tmp_path, failing):
    calibration = write_calibration(tmp_path / "c.xml", baseline=0.220)
    told = failing(calibration, *NEEDED, "--projector-size", 1024, 768)
    assert "0.234 mm apart, which cannot be; is the translation in m?" in told


def test_a_projector_without_its_pose(camera_info, failing):
    told = failing(camera_info, *NEEDED, "--projector", camera_info, status=2)
    assert "needs both its --projector and its --projector-pose" in told


def test_a_projector_given_twice(camera_info, tmp_path, failing):
    calibration = write_calibration(tmp_path / "c.xml")
    words = ("--projector-size", 1024, 768, "--projector", camera_info)
    told = failing(calibration, *NEEDED, *words, status=2)
    assert "holds the projector: leave out --projector" in told


def test_a_tcp_where_nothing_is_measured(camera_info, failing):
    told = failing(camera_info, *NEEDED, "--tcp-distance", 900, status=2)
    assert "400 to 800 mm, as --working-distance says, got 900" in told


def test_exposure_times_the_wrong_way_round(camera_info, failing):
    words = ("--name", "mine", "--exposures", 500, 1, "--working-distance", 400, 800)
    assert "exposure times need 0 < minimum ≤ maximum" in failing(camera_info, *words)


def test_a_calibration_of_a_program_that_nobody_knows(tmp_path, failing):
    path = tmp_path / "c.yml"
    path.write_text("%YAML:1.0\n---\nfocal: 3.0\n", encoding="utf-8")
    told = failing(path, *NEEDED)
    assert "no camera matrix" in told
    assert "the file has focal" in told


def test_another_suffix(camera_info, failing):
    told = failing(camera_info, *NEEDED, "-o", "sensor.yaml", status=2)
    assert "a sensor's document ends in .json, got the name sensor.yaml" in told


def test_a_working_distance_in_metres_is_remarked_on(tmp_path, run_json):
    calibration = write_calibration(tmp_path / "c.yml")
    words = (
        *("sensor", calibration, "--name", "mine", "--exposures", 1, 500),
        *("--projector-size", 1024, 768, "-o", tmp_path / "s.json"),
    )
    (note,) = run_json(*words, "--working-distance", 0.4, 0.8)["notes"]
    assert "if these are metres, multiply by 1000" in note
    assert run_json(*words, "--working-distance", 400, 800)["notes"] == []


# -- two cameras --------------------------------------------------------------------------------

PROJECTION = "projection_matrix:\n  rows: 3\n  cols: 4\n  data: "


def stereo_infos(tmp_path, baseline_m=0.06):
    """Left and right, of raw images with distortion and of rectified ones."""
    paths = []
    for name, offset in (("left", 0.0), ("right", -1200.0 * baseline_m)):
        row = [1200.0, 0, 640, offset, 0, 1200, 480, 0, 0, 0, 1, 0]
        paths.append(tmp_path / f"{name}.yaml")
        paths[-1].write_text(f"{CAMERA_INFO}{PROJECTION}{row}\n", encoding="utf-8")
    return paths


def test_two_cameras_are_a_stereo_sensor(tmp_path, run_json):
    left, right = stereo_infos(tmp_path)
    path = tmp_path / "s.json"
    facts = run_json("sensor", left, right, "--rectified", *NEEDED, "-o", path)
    sensor = read_sensor(path)
    assert len(sensor.cameras) == 2
    assert sensor.projector is None
    assert sensor.first_from_camera[1].translation_mm.tolist() == pytest.approx([60, 0, 0])
    assert facts["baseline_mm"] == pytest.approx(60.0)


def test_raw_or_rectified_is_asked(tmp_path, failing):
    left, right = stereo_infos(tmp_path)
    assert "say --raw or --rectified" in failing(left, *NEEDED)
    assert "say --raw or --rectified" in failing(left, right, *NEEDED)


def test_one_rectified_camera(tmp_path, run_json):
    left, _ = stereo_infos(tmp_path)
    run_json("sensor", left, "--rectified", *NEEDED, "-o", tmp_path / "s.json")
    assert read_sensor(tmp_path / "s.json").camera.distortion == ()


@pytest.mark.parametrize(("baseline_m", "length"), [(60.0, "60 000"), (6e-5, "0.06")])
def test_cameras_that_cannot_stand_so(baseline_m, length, tmp_path, failing):
    told = failing(*stereo_infos(tmp_path, baseline_m), "--rectified", *NEEDED)
    assert f"{length} mm apart" in told
    assert "P[3] is −fx·baseline in m" in told


def test_a_stereo_sensor_takes_no_projector(tmp_path, failing, camera_info):
    words = ("--raw", *NEEDED, "--projector", camera_info)
    assert "leave out --projector" in failing(*stereo_infos(tmp_path), *words, status=2)


# -- nodes by name, and no calibration at all ----------------------------------------------------


def opencv_stereo(tmp_path, names="M1 D1 M2 D2"):
    """OpenCV's two files; the second device stands 220 mm to the right of the first."""
    k1, d1, k2, d2 = names.split()
    paths = []
    for name, nodes in {
        "intrinsics.yml": {
            k1: np.array([[1100.0, 0, 640], [0, 1101, 480], [0, 0, 1]]), d1: np.zeros((1, 5)),
            k2: np.array([[900.0, 0, 512], [0, 900, 384], [0, 0, 1]]), d2: np.zeros((1, 5))},
        "extrinsics.yml": {"R": np.eye(3), "T": np.array([[-220.0], [0], [0]])},
    }.items():  # fmt: skip
        paths.append(tmp_path / name)
        storage = cv2.FileStorage(str(paths[-1]), cv2.FILE_STORAGE_WRITE)
        for key, value in nodes.items():
            storage.write(key, value)
        storage.release()
    return paths


def test_opencv_s_two_files_are_two_cameras_or_camera_and_projector(tmp_path, run_json):
    files = opencv_stereo(tmp_path)
    words = ("sensor", *files, *NEEDED, "--image-size", 1280, 960, "-o", tmp_path / "s.json")
    run_json(*words)
    assert len(read_sensor(tmp_path / "s.json").cameras) == 2
    run_json(*words, "--projector-size", 1024, 768)
    sensor = read_sensor(tmp_path / "s.json")
    assert (len(sensor.cameras), sensor.projector.width) == (1, 1024)


def test_keys_say_which_node_is_what(tmp_path, run, failing, run_json):
    files = opencv_stereo(tmp_path, "A1 V1 A2 V2")
    sizes = ("--image-size", 1280, 960, "--projector-size", 1024, 768, "-o", tmp_path / "s.json")
    told = failing(*files, *NEEDED, *sizes)
    answer = "camera_matrix=A1,projector_matrix=A2"
    assert f"--keys {answer}" in told
    told = run_json("sensor", *files, *NEEDED, *sizes, "--keys", answer)
    assert read_sensor(tmp_path / "s.json").projector.camera.fx == 900.0
    assert "projector from A2, V2" in str(told)
    assert "no node 'A3'" in failing(*files, *NEEDED, *sizes, "--keys", "camera_matrix=A3")


@pytest.mark.parametrize(
    ("words", "focal_px"),
    [
        (("--field-of-view", 700, 437.5, 800), 1280 * 800 / 700),
        (("--field-of-view-deg", 60, 39.6), 640 / np.tan(np.pi / 6)),
        (("--focal-length", 12, "--pixel-size", 4.8), 2500.0),
    ],
)
def test_a_sensor_without_a_calibration(tmp_path, run_json, words, focal_px):
    told = run_json("sensor", "--resolution", 1280, 800, *words, *NEEDED, "-o",
                    tmp_path / "s.json")  # fmt: skip
    camera = read_sensor(tmp_path / "s.json").camera
    assert camera.fx == pytest.approx(focal_px)
    assert (camera.cx, camera.cy, camera.distortion) == (639.5, 399.5, ())
    (note,) = told["notes"]
    assert "not for decoding" in note


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        ((), 2, "give a calibration's file"),
        (("--resolution", 1280, 800), 2, "got --resolution"),
        (("--resolution", 1280, 800, "--focal-length", 12), 2, "--pixel-size"),
        (("--resolution", 800, 1280, "--field-of-view", 700, 437.5, 800), 1, "exchanged"),
        (("--resolution", 1280, 800, "--field-of-view", 700, 437.5, -1), 1, "positive"),
    ],
)
def test_what_describes_no_camera(failing, words, status, message):
    assert message in failing(*words, *NEEDED, status=status)


def test_a_projector_s_size_without_a_projector(tmp_path, failing):
    (tmp_path / "c.json").write_text('{"fx": 900, "fy": 900, "cx": 640, "cy": 480}')
    words = ("--image-size", 1280, 960, "--projector-size", 1024, 768)
    assert "has none" in failing(tmp_path / "c.json", *words, *NEEDED, status=2)


def test_a_calibration_needs_no_field_of_view(camera_info, failing):
    told = failing(camera_info, "--resolution", 1280, 800, *NEEDED, status=2)
    assert "leave out --resolution" in told

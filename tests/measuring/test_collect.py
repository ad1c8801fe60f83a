"""A folder as a scanner leaves it: three views at four exposure times, made here."""

import json
import shutil

import cv2
import numpy as np
import pytest
from PIL import Image

from exposight.cell import (
    ActiveSensor,
    CampaignFolder,
    CampaignWriter,
    ExposureRange,
    exif_exposure_ms,
    find_recordings,
    write_sensor,
)
from exposight.cli.app import run as run_program
from exposight.cli.collect import left_out_lines
from exposight.errors import AmbiguousError, FormatError, MissingFileError
from exposight.files import Reading, reading_as
from exposight.geometry import PinholeCamera, RigidTransform

WIDTH, HEIGHT, FOCAL = 320, 240, 400.0
HOLES = {
    "h1": (-50.0, -35.0, 8.0),
    "h2": (45.0, -38.0, 9.0),
    "h3": (-45.0, 40.0, 7.0),
    "h4": (52.0, 33.0, 10.0),
}
TIMES = (2.0, 7.5, 20.0, 90.0)
HAND_EYE = RigidTransform.from_fanuc_wpr((40, -75, 120), 3, -5, 88)
BASE_FROM_PART = RigidTransform.from_fanuc_wpr((900, 200, 300), 1, 2, 30)
VIEWS = {
    f"{i:02d}": RigidTransform.from_fanuc_wpr((4.0 * i, -3.0, 480.0 + 10 * i), 180.0, 4.0 * i, 0.0)
    for i in (1, 2, 3)
}


def _scene(pose, exposure_ms):
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    ray = np.stack(
        [(u - (WIDTH - 1) / 2) / FOCAL, (v - (HEIGHT - 1) / 2) / FOCAL, np.ones_like(u)], -1
    )
    normal = pose.rotation[:, 2]
    points = ray * ((normal @ pose.translation_mm) / (ray @ normal))[..., None]
    x, y, _ = np.moveaxis(pose.inverse().apply(points), -1, 0)
    hole = np.zeros(x.shape, bool)
    for cx, cy, radius in HOLES.values():
        hole |= (x - cx) ** 2 + (y - cy) ** 2 < radius**2
    light = (8.0 * exposure_ms * (1 + 0.2 * x / 100)) + 3
    image = np.clip(np.where(hole, 3, light), 0, 255)
    points[hole | (light < 12) | (light > 300)] = np.nan
    return np.rint(image).astype(np.uint8), points.astype(np.float32)


def _write_ply(path, points):
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex "
        f"{points.shape[0] * points.shape[1]}\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n"
    )
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    scans = folder / "scans"
    scans.mkdir()
    for view, pose in VIEWS.items():
        for time in TIMES:
            image, points = _scene(pose, time)
            stem = f"P{view}_{time:g}ms".replace(".", "_")
            cv2.imwrite(str(scans / f"{stem}.png"), image)
            _write_ply(scans / f"{stem}.ply", points)
    rows = [
        f"{name};hole;{x:g};{y:g};0;0;0;1;{2 * r:g}".replace(".", ",")
        for name, (x, y, r) in HOLES.items()
    ]
    header = "Name;Kind;X [mm];Y [mm];Z [mm];nx;ny;nz;diameter [mm]"
    (folder / "holes.csv").write_text("\n".join([header, *rows]) + "\n", "cp1252")
    lines = []
    for view, pose in VIEWS.items():
        flange = BASE_FROM_PART @ pose.inverse() @ HAND_EYE.inverse()
        x, y, z = flange.translation_mm
        a, b, c = flange.to_kuka_abc()
        lines.append(
            f"DECL E6POS XP{int(view)}={{X {x:.6f},Y {y:.6f},Z {z:.6f},A {a:.6f},B {b:.6f},"
            f"C {c:.6f},S 2,T 10}}"
        )
    (folder / "door.dat").write_text("\n".join(lines))
    np.savetxt(folder / "hand_eye.txt", HAND_EYE.to_matrix())
    np.savetxt(folder / "part.txt", BASE_FROM_PART.to_matrix())
    camera = PinholeCamera(
        width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=(WIDTH - 1) / 2, cy=(HEIGHT - 1) / 2
    )
    write_sensor(
        folder / "sensor.json",
        ActiveSensor(
            name="cam",
            cameras=(camera,),
            first_from_camera=(RigidTransform(),),
            projector=None,
            camera_from_tcp=RigidTransform(translation_mm=[0, 0, 500]),
            exposure=ExposureRange(min_ms=0.5, max_ms=200.0, increment_ms=0.1),
            working_distance_mm=(300.0, 700.0),
        ),
    )
    for view, pose in VIEWS.items():
        (folder / "poses").mkdir(exist_ok=True)
        np.savetxt(folder / "poses" / f"{view}.txt", pose.to_matrix())
    return folder


@pytest.fixture
def own(recorded, tmp_path):
    return shutil.copytree(recorded, tmp_path / "own")


@pytest.fixture
def collect(capsys):
    def call(folder, *more, name="P{view}_{exposure:f}ms", robot=True):
        poses = (
            [
                *("--poses", folder / "door.dat", "--hand-eye", folder / "hand_eye.txt"),
                *("--part-pose", folder / "part.txt"),
            ]
            if robot
            else ["--poses", folder / "poses"]
        )
        words = ["collect", folder / "scans", "--features", folder / "holes.csv"]
        words += ["--sensor", folder / "sensor.json", "-o", folder / "door", "--json", *poses]
        words += ["--name", name] if name else []
        capsys.readouterr()
        status = run_program([str(word) for word in (*words, *more)])
        return status, json.loads(capsys.readouterr().out)

    return call


def test_a_folder_becomes_a_campaign(own, collect):
    status, result = collect(own)
    assert status == 0, result
    assert result["captures"] == result["new"] == 12
    assert result["exposures_ms"] == list(TIMES)
    assert [row["captures"] for row in result["by_view"]] == [4, 4, 4]
    assert result["models_need"].startswith("enough to train quality")
    campaign = CampaignFolder(own / "door")
    capture = campaign.capture(0)
    assert capture.camera_from_part.to_matrix() == pytest.approx(VIEWS["01"].to_matrix(), abs=1e-4)
    assert campaign.part.features[0].radius_mm == 8.0


def test_it_goes_on_and_notices_what_changed(own, collect):
    late = [own / "scans" / f"P03_90ms{suffix}" for suffix in (".png", ".ply")]
    for path in late:
        path.rename(own / path.name)
    assert collect(own)[1]["captures"] == 11
    for path in late:
        (own / path.name).rename(path)
    status, result = collect(own)
    assert (status, result["new"], result["captures"]) == (0, 1, 12)
    image = cv2.imread(str(own / "scans" / "P01_2ms.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(own / "scans" / "P01_2ms.png"), image // 2)
    status, result = collect(own)
    assert (status, result["new"]) == (1, 0)
    assert "changed since" in result["left_out"]["P01_2ms.png"]


def test_what_was_taken_before_an_interruption_is_kept(own, collect, monkeypatch):
    written = CampaignWriter.add
    done = []

    def stops(writer, capture):
        if len(done) == 5:
            raise KeyboardInterrupt
        done.append(capture.key)
        written(writer, capture)

    monkeypatch.setattr(CampaignWriter, "add", stops)
    assert collect(own)[0] == 130
    monkeypatch.setattr(CampaignWriter, "add", written)
    status, result = collect(own)
    assert (status, result["new"], result["captures"]) == (0, 7, 12)


def test_an_unreadable_file_does_not_stop_the_rest(own, collect):
    path = own / "scans" / "P02_20ms.png"
    path.write_bytes(path.read_bytes()[:200])
    (own / "scans" / "P03_20ms.ply").unlink()
    status, result = collect(own)
    assert (status, result["captures"]) == (1, 10)
    assert set(result["left_out"]) == {"P02_20ms.png", "P03_20ms.png"}
    assert "no cloud beside it" in result["left_out"]["P03_20ms.png"]


def test_a_wrong_unit_is_found_while_collecting(own, collect):
    status, result = collect(own, "--cloud-unit", "m")
    assert status == 1
    assert "P01" in result["error"]["message"]
    assert not list((own / "door" / "captures").iterdir())


def test_an_inverse_hand_eye_matrix_is_not_silent(own, collect):
    np.savetxt(own / "hand_eye.txt", HAND_EYE.inverse().to_matrix())
    status, result = collect(own)
    assert status == 1
    assert "the inverse of flange_from_camera would put points" in result["error"]["message"]


def test_exposure_times_from_exif_and_tables(own, collect, tmp_path):
    table = ["Datei;Belichtungszeit [µs]"]
    for path in sorted((own / "scans").glob("*.png")):
        view, time = path.stem[:3], float(path.stem[4:-2].replace("_", "."))
        index = TIMES.index(time)
        image = Image.open(path)
        exif = Image.Exif()
        exif[0x8769] = {0x829A: time / 1000}
        image.load()
        path.unlink()
        image.save(own / "scans" / f"{view}-{index}.png", exif=exif)
        path.with_suffix(".ply").rename(own / "scans" / f"{view}-{index}.ply")
        table.append(f"{view}-{index}.png;{time * 1000:g}")
    assert exif_exposure_ms(own / "scans" / "P01-1.png") == pytest.approx(7.5)
    status, result = collect(own, name="P{view}-{}")
    assert status == 0, result
    assert result["exposures_ms"] == pytest.approx(list(TIMES))
    (own / "t.csv").write_text("\n".join(table), "cp1252")
    shutil.rmtree(own / "door")
    assert collect(own, "--table", own / "t.csv", name="P{view}-{}")[0] == 0
    table = [row.replace("P01-0.png;2000", "P01-0.png;4000") for row in table if "P02-0" not in row]
    (own / "t.csv").write_text("\n".join(table), "cp1252")
    shutil.rmtree(own / "door")
    status, result = collect(own, "--table", own / "t.csv", name="P{view}-{}")
    assert status == 1
    assert "EXIF says 2 ms, the table says 4 ms" in result["left_out"]["P01-0.png"]
    assert "no exposure time of it" in result["left_out"]["P02-0.png"]


def test_views_without_a_pose_are_all_named(own, collect):
    (own / "poses" / "02.txt").unlink()
    (own / "poses" / "03.txt").unlink()
    status, result = collect(own, robot=False)
    assert status == 1
    assert "2 of 3 views" in result["error"]["message"]


# -- names --------------------------------------------------------------------------------------


def _touch(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.zeros((4, 4), np.uint8))


@pytest.mark.parametrize(
    ("names", "pattern", "found"),
    [
        (["P01_7ms.png", "P02_7,5ms.PNG"], "P{view}_{exposure}ms", {("01", 7), ("02", 7.5)}),
        (["P01_7_5ms.png", "P01_10ms.png"], "P{view}_{exposure}ms", {("01", 7.5), ("01", 10)}),
        (["p01_7p5MS.png"], "P{view}_{exposure}ms.png", {("01", 7.5)}),
        (["left/500us/a.png"], "{view}/{exposure}us/*", {("left", 0.5)}),
        (["a/0.02s_x.png"], "{view}/{exposure}s_{}", {("a", 20)}),
        (["P01_7ms.png", "P02_9ms.png"], None, {("P01", 7), ("P02", 9)}),
        (["7ms/P01.png", "9ms/P01.png"], None, {("P01", 7), ("P01", 9)}),
        (["scan_P1_500us_img.png", "scan_P2_500us_img.png"], None, {("P1", 0.5), ("P2", 0.5)}),
        (["P01.png", "P02.png"], None, {("P01", None), ("P02", None)}),
    ],
)
def test_names_tell_view_and_exposure_time(tmp_path, names, pattern, found):
    _touch(tmp_path, *names)
    recordings = find_recordings(tmp_path, name=pattern)
    assert {(each.view, each.exposure_ms) for each in recordings.found} == found


@pytest.mark.parametrize(
    ("names", "pattern", "said"),
    [
        (["P01_1_7ms.png", "P01_2_7ms.png"], "P{view}_{exposure}ms", "exposure:f"),
        (["P01_7.png"], "P{view}_{exposure}", "exposure=ms"),
        (["P01_7ms.png", "other.png"], None, "say how they are named"),
        (["P01_7_5ms.png"], None, "behind an underscore"),
    ],
)
def test_names_that_two_readings_fit_are_asked_for(tmp_path, names, pattern, said):
    _touch(tmp_path, *names)
    with pytest.raises(AmbiguousError, match=said):
        find_recordings(tmp_path, name=pattern)


def test_other_files_are_left_out_by_name(tmp_path):
    _touch(tmp_path, "P01_7.png", "dark.png")
    with reading_as(Reading(exposure="us")):
        recordings = find_recordings(tmp_path, name="P{view}_{exposure}")
    assert recordings.found[0].exposure_ms == 0.007
    assert list(recordings.faults) == ["dark.png"]
    with pytest.raises(FormatError, match="none of its 2 images"):
        find_recordings(tmp_path, name="Q{view}")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingFileError, match="no image in it"):
        find_recordings(tmp_path / "empty")


def test_one_pose_without_a_name_is_that_of_all_views(own, collect):
    shutil.rmtree(own / "poses")
    for path in (own / "scans").glob("P0[23]*"):
        path.unlink()
    for path in sorted((own / "scans").glob("P01*")):
        shutil.copy(path, own / "scans" / path.name.replace("P01", "P09"))
    np.savetxt(own / "poses", VIEWS["01"].to_matrix())
    status, result = collect(own, robot=False)
    assert (status, result["captures"], result["views"]) == (0, 8, 2)
    assert any("one pose for all views" in remark for remark in result["recognised"])


def test_a_depth_image_beside_its_image_is_the_cloud(tmp_path):
    cv2.imwrite(str(tmp_path / "P01_5ms.png"), np.full((4, 6), 9, np.uint8))
    cv2.imwrite(str(tmp_path / "P01_5ms.tif"), np.full((4, 6), 6000, np.uint16))
    (found,) = find_recordings(tmp_path, name="P{view}_{exposure}ms").found
    assert found.image.suffix == ".png"
    assert found.cloud is not None
    assert found.cloud.suffix == ".tif"


def test_reasons_that_are_alike_are_said_once():
    lines = left_out_lines(
        {f"v{i}/e_{i}ms.png": f"scan/v{i}/e_{i}ms.tif: {i}.5 mm" for i in range(9)}
    )
    assert lines == [
        "v0/e_0ms.png: scan/v0/e_0ms.tif: 0.5 mm (and 8 more like it, up to v8/e_8ms.png)"
    ]

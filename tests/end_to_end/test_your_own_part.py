"""docs/your-own-part.md, command by command, on a folder in which nothing is exposight's own."""

import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.geometry.drilled_plates import CELL, HOLE, plate

from exposight.cell import CampaignFolder, read_features
from exposight.geometry import RigidTransform
from exposight.observing import read_observations

PAGE = Path(__file__).parents[2] / "docs" / "your-own-part.md"
TIMES_MS = (2, 4, 8, 16, 32)
WIDTH, HEIGHT, FOCAL = 320, 240, 400.0
N_HOLES, RADIUS = 6, 5.0
CAMERA_FROM_PROJECTOR = RigidTransform.from_fanuc_wpr((150.0, 0.0, 0.0), 0.0, -14.0, 0.0)
HAND_EYE = RigidTransform.from_fanuc_wpr((30.0, -70.0, 115.0), 2.0, -3.0, 90.5)
BASE_FROM_PART = RigidTransform.from_fanuc_wpr((1200.0, 150.0, 320.0), 4.0, -2.0, 35.0)


def views():
    """The part before the camera, which looks at its upper side."""
    middle = RigidTransform(translation_mm=np.array([-CELL * (N_HOLES - 1) / 2, 0.0, 0.0]))
    for x, z, w, p in ((0, 600, 0, 0), (15, 560, 8, -6), (-10, 640, -7, 9), (5, 610, 4, 14)):
        yield RigidTransform.from_fanuc_wpr((x, 0.0, z), 180.0 + w, p, 0.0) @ middle


def captured(camera_from_part, exposure_ms, rng):
    """Return the grey image and the cloud of a matt plate, lit by the projector."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    rays = np.dstack([(u - 159.5) / FOCAL, (v - 119.5) / FOCAL, np.ones(u.shape)])
    normal = camera_from_part.rotation[:, 2]
    points = rays * ((normal @ camera_from_part.translation_mm) / (rays @ normal))[..., None]
    x, y, _ = np.moveaxis(camera_from_part.inverse().apply(points.reshape(-1, 3)), -1, 0).reshape(
        3, HEIGHT, WIDTH
    )
    away = (x + CELL / 2) % CELL - CELL / 2
    on_part = (np.abs(y) < CELL / 2) & (x > -CELL / 2) & (x < CELL * (N_HOLES - 0.5))
    on_part &= np.hypot(away, y) > RADIUS
    to_light = CAMERA_FROM_PROJECTOR.translation_mm - points
    distance = np.linalg.norm(to_light, axis=-1)
    light = np.abs(to_light @ normal) / distance * (600.0 / distance) ** 2
    grey = np.where(on_part, 9.0 * exposure_ms * light, 0.0) + 4.0
    grey = np.clip(np.rint(grey + rng.normal(0, 0.8, grey.shape)), 0, 255)
    points[~on_part | (grey < 18) | (grey > 250)] = np.nan
    return grey.astype(np.uint8), points


def write_ply(path, points):
    """Write the valid points, and which pixel has which, as range scanners do."""
    valid = np.isfinite(points[..., 0]).ravel()
    rows = points.reshape(-1, 3)[valid]
    number = np.cumsum(valid) - 1
    header = (
        f"ply\nformat ascii 1.0\nobj_info num_cols {WIDTH}\nobj_info num_rows {HEIGHT}\n"
        f"element vertex {len(rows)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element range_grid {WIDTH * HEIGHT}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    cells = "".join(f"1 {n}\n" if there else "0\n" for n, there in zip(number, valid, strict=True))
    path.write_text(header + "".join(f"{x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in rows) + cells)


def write_calibration(path):
    def node(name, values):
        rows = np.atleast_2d(np.asarray(values, dtype=float))
        data = ", ".join(map(repr, rows.ravel().tolist()))
        return (
            f"{name}: !!opencv-matrix\n   rows: {rows.shape[0]}\n   cols: {rows.shape[1]}\n"
            f"   dt: d\n   data: [ {data} ]\n"
        )

    inverse = CAMERA_FROM_PROJECTOR.inverse()
    path.write_text(
        "%YAML:1.0\n---\n"
        + node("cam_K", [[FOCAL, 0, 159.5], [0, FOCAL, 119.5], [0, 0, 1]])
        + node("cam_kc", [0.0] * 5)
        + node("proj_K", [[1100.0, 0, 455.5], [0, 1100.0, 341.5], [0, 0, 1]])
        + node("proj_kc", [0.0] * 5)
        + node("R", inverse.rotation)
        + node("T", inverse.translation_mm[:, None])
        + f"cam_width: {WIDTH}\ncam_height: {HEIGHT}\nproj_width: 912\nproj_height: 684\n"
    )


def write_stl(path):
    mesh = plate([HOLE] * N_HOLES, corners=48)
    rows = np.zeros(len(mesh.faces), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("_", "<u2")])
    rows["c"] = mesh.vertices[mesh.faces]
    path.write_bytes(b" " * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A user's folder: a scan, a German list, a robot's program, a calibration, a mesh."""
    folder, rng = tmp_path_factory.mktemp("own"), np.random.default_rng(4)
    (folder / "scan").mkdir()
    program = ["DEF scan()"]
    for number, camera_from_part in enumerate(views(), start=1):
        flange = BASE_FROM_PART @ camera_from_part.inverse() @ HAND_EYE.inverse()
        turn = Rotation.from_matrix(flange.rotation).as_euler("ZYX", degrees=True)
        numbers = zip("XYZABC", (*flange.translation_mm, *turn), strict=True)
        frame = ",".join(f"{key} {value:.5f}" for key, value in numbers)
        program.append(f"DECL E6POS XP{number:02d}={{{frame},S 2,T 35}}")
        for time_ms in TIMES_MS:
            image, points = captured(camera_from_part, time_ms, rng)
            path = folder / "scan" / f"P{number:02d}_{time_ms}ms"
            cv2.imwrite(str(path.with_suffix(".png")), image)
            write_ply(path.with_suffix(".ply"), points)
    (folder / "poses.src").write_text("\n".join([*program, "END", ""]))
    np.savetxt(folder / "hand_eye.txt", HAND_EYE.to_matrix())
    np.savetxt(folder / "part_in_base.txt", BASE_FROM_PART.to_matrix())
    holes = "".join(
        f"B{i + 1};Bohrung;{CELL * i:.1f};0,0;0,0;0;0;1;10,0\r\n".replace(".", ",")
        for i in range(N_HOLES)
    )
    header = "Merkmal;Art;X [mm];Y [mm];Z [mm];I;J;K;Ø [mm]\r\n"
    (folder / "Merkmale.csv").write_bytes((header + holes).encode("cp1252"))
    write_calibration(folder / "calibration.yml")
    write_stl(folder / "bracket.stl")
    return folder


def commands():
    """Return the page's commands in their order."""
    blocks = re.findall(r"^```\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    lines = [line for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("exposight ")]


@pytest.mark.slow
def test_each_command_of_the_page_works_and_what_comes_of_them_is_right(folder, run, monkeypatch):
    monkeypatch.chdir(folder)
    called = commands()
    assert len(called) >= 10
    said = {}
    for line in called:
        words = shlex.split(line)[1:]
        ended = run(*words)
        assert ended.exit_code == 0, f"{line}\n{ended.stdout}{ended.stderr}"
        said[words[0], words[-1]] = " ".join(ended.stdout.split())
    campaign = CampaignFolder(folder / "campaign")
    assert len(campaign) == 4 * len(TIMES_MS)
    by_view = {}
    for each in campaign.descriptions():
        by_view.setdefault(each.view, each.camera_from_part)
    for found, true in zip(by_view.values(), views(), strict=True):
        assert np.allclose(found.to_matrix(), true.to_matrix(), atol=1e-2)
    radii = [feature.radius_mm for feature in campaign.part.features]
    assert radii == pytest.approx([RADIUS] * N_HOLES)
    rows = read_observations(folder / "models" / "observations.csv").measured().frame
    assert rows.height == N_HOLES * len(campaign)
    good = rows.filter(rows["i_avg"].is_between(40, 200))
    assert good["p_norm"].min() > 0.95
    assert "decimal comma" in said["collect", "campaign"]
    # From CAD the same holes come, under the names of the list.
    found = {f.name: f.part_from_feature.translation_mm for f in read_features(
        folder / "bracket" / "features.csv")}  # fmt: skip
    assert found.keys() == {f"B{i + 1}" for i in range(N_HOLES)}
    assert np.allclose(found["B3"], [2 * CELL, 0, 0], atol=0.01)
    for name in ("plan.json", "exposures.json", "report/report.html", "bracket/part.html"):
        assert (folder / name).stat().st_size > 1000

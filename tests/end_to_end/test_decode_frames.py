"""``exposight decode``: frames to points and their noise; frames alone to a sequence."""

import cv2
import numpy as np
import pytest

from exposight.cell import read_cloud
from exposight.geometry import PinholeCamera, ProjectorCamera, RigidTransform
from exposight.imaging import read_sequence

_SIZE = (512, 384)
_CAMERA = PinholeCamera(width=240, height=160, fx=300.0, fy=300.0, cx=119.5, cy=79.5)
_PROJECTOR = PinholeCamera(width=512, height=384, fx=540.0, fy=540.0, cx=255.5, cy=191.5)
_TURN = RigidTransform.from_fanuc_wpr([120.0, 0.0, 0.0], 0.0, -13.0, 0.0)
_RIG = ProjectorCamera(camera=_CAMERA, projector=_PROJECTOR, projector_from_camera=_TURN.inverse())


def _depth_mm():
    """A wall that recedes to the right, and a box before it."""
    x, y = np.moveaxis(_CAMERA.rays(), -1, 0)
    wall = 520.0 / (1.0 - 0.15 * x)
    return np.where((np.abs(x) < 0.12) & (np.abs(y) < 0.1), wall - 30.0, wall)


def _frames(fringes, bits=0):
    """Frames of four steps of each fringe, then of bits, white and black where there are any."""
    depth = _depth_mm()
    rays = np.dstack([_CAMERA.rays(), np.ones(depth.shape)])
    points = _RIG.projector_from_camera.apply(rays * depth[..., None])
    column = _PROJECTOR.project(points)[..., 0]
    light = [
        0.5 + 0.45 * np.cos(2 * np.pi * periods * column / _SIZE[0] - np.pi / 2 * k)
        for periods in fringes
        for k in range(4)
    ]
    code = np.floor((column + 0.5) / (_SIZE[0] >> bits)).astype(int)
    light += [(code ^ (code >> 1)) >> (bits - 1 - i) & 1 for i in range(bits)]
    light += [np.ones_like(column), np.zeros_like(column)] if bits else []
    noise = np.random.default_rng(4)
    return [20 + 180 * each + noise.normal(0, 1, each.shape) for each in light]


def _write(folder, frames):
    folder.mkdir(exist_ok=True)
    for i, frame in enumerate(frames):
        grey = np.clip(np.rint(frame), 0, 255).astype(np.uint8)
        assert cv2.imwrite(str(folder / f"frame_{i:02}.png"), grey)
    return folder


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / "calibration.yml"
    path.write_text(_RIG.to_slstudio(), encoding="utf-8")
    return path


def test_a_sequence_is_written_that_is_right_and_can_be_read(tmp_path, run_json):
    folder = _write(tmp_path / "frames", _frames([64, 63, 56]))
    path = tmp_path / "sequence.toml"
    document = run_json("decode", folder, "--guess", "--projector-size", *_SIZE, "-o", path)
    sequence = read_sequence(path)
    assert [fringe.periods for fringe in sequence.columns.fringes] == [56, 63, 64]
    assert [fringe.frames[0] for fringe in sequence.columns.fringes] == [8, 4, 0]
    assert sequence.rows is None
    assert (sequence.projector_width, sequence.projector_height) == _SIZE
    fringes = [row for row in document["guess"] if row["what"].startswith("fringe")]
    assert len(fringes) == 3
    assert all(0.9 < row["sure"] <= 1 for row in fringes)
    assert {row["what"] for row in document["guess"] if row["sure"] is None} == {
        "mirrored or turned"
    }


def test_without_a_projectors_size_that_is_said_to_be_unknown(tmp_path, run):
    folder = _write(tmp_path / "frames", _frames([1, 12]))
    result = run("decode", folder, "--guess")
    assert result.exit_code == 0
    assert "--projector-size" in result.stdout
    assert "assumption" in " ".join(result.stdout.split())


@pytest.mark.parametrize(
    ("fringes", "bits"), [((64, 63, 56), 0), ((16,), 5), ((12, 1), 0)], ids=["beats", "code", "two"]
)
def test_with_a_calibration_the_cloud_is_right(fringes, bits, tmp_path, calibration, run_json):
    folder = _write(tmp_path / "frames", _frames(fringes, bits))
    path = tmp_path / "cloud.ply"
    document = run_json("decode", folder, "--guess", "-c", calibration, "-o", path)
    assert document["guess"]
    cloud = read_cloud(path)
    assert cloud.n_valid > 0.9 * cloud.valid.size
    error = np.abs(cloud.points[..., 2] - _depth_mm())
    assert np.nanmedian(error) < 0.5


def test_a_calibration_in_two_files_without_sizes(tmp_path, run_json):
    folder = _write(tmp_path / "frames", _frames([64, 63, 56]))
    pose = _RIG.projector_from_camera
    devices = {"M1": _CAMERA.matrix, "D1": np.zeros(5), "M2": _PROJECTOR.matrix, "D2": np.zeros(5)}
    np.savez(tmp_path / "intrinsics.npz", **devices)
    np.savez(tmp_path / "extrinsics.npz", R=pose.rotation, T=pose.translation_mm)
    run_json(
        *("decode", folder, "--guess", "--projector-size", *_SIZE, "-o", tmp_path / "c.ply"),
        *("-c", tmp_path / "intrinsics.npz", "--extrinsics", tmp_path / "extrinsics.npz"),
    )
    error = np.abs(read_cloud(tmp_path / "c.ply").points[..., 2] - _depth_mm())
    assert np.nanmedian(error) < 0.5


def test_photographs_are_no_patterns(tmp_path, run):
    noise = np.random.default_rng(2)
    scene = 100 + 40 * cv2.GaussianBlur(noise.normal(0, 20, (160, 240)), (0, 0), 4)
    folder = _write(tmp_path / "photos", [scene + noise.normal(0, 1, scene.shape)] * 6)
    result = run("decode", folder, "--guess")
    assert result.exit_code == 1
    assert "no pattern" in result.stderr


def test_photographs_of_different_things_are_no_patterns_either(tmp_path, run):
    noise = np.random.default_rng(3)
    blobs = [cv2.GaussianBlur(noise.normal(0, 1, (160, 240)), (0, 0), 6) for _ in range(7)]
    folder = _write(tmp_path / "photos", [120 + 50 * each / each.std() for each in blobs])
    result = run("decode", folder, "--guess")
    assert result.exit_code == 1
    assert "patterns" in result.stderr


_SEQUENCE = """name = "two fringes"
projector_width = 512
projector_height = 384

[[columns.fringes]]
periods = 1
frames = {coarse}

[[columns.fringes]]
periods = 16
frames = {fine}
"""


def _two_fringes(tmp_path, coarse, fine):
    """Write a recording of two fringes and return the words of the call that decodes it."""
    folder = _write(tmp_path / "frames", _frames([1, 16]))
    path = tmp_path / "s.toml"
    unused = sorted(set(range(8)) - {*coarse, *fine})
    path.write_text(f"unused_frames = {unused}\n" + _SEQUENCE.format(coarse=coarse, fine=fine))
    return ("decode", folder, "-s", path, "-c", tmp_path / "calibration.yml")


def test_the_standard_deviation_of_each_point_is_written(tmp_path, calibration, run_json):
    call = _two_fringes(tmp_path, [0, 1, 2, 3], [4, 5, 6, 7])
    document = run_json(*call, "-o", tmp_path / "cloud.ply")
    cloud = read_cloud(tmp_path / "cloud.ply")
    sigma = np.nanmedian(cloud.sigma_z_mm)
    assert document["sigma_z_mm"] == pytest.approx(sigma, rel=1e-3)
    error = (cloud.points[..., 2] - _depth_mm())[np.abs(_CAMERA.rays()[..., 0]) > 0.15]
    error = error[np.isfinite(error)]
    assert sigma == pytest.approx(np.subtract(*np.percentile(error, [84, 16])) / 2, rel=0.15)


def test_what_three_steps_do_not_tell_is_said(tmp_path, calibration, run_json):
    call = _two_fringes(tmp_path, [0, 1, 2], [4, 5, 6])
    path = tmp_path / "s.toml"
    path.write_text(path.read_text() + "shifts_deg = [0, 90, 180]\n")
    path.write_text(
        path.read_text().replace("[0, 1, 2]\n", "[0, 1, 2]\nshifts_deg = [0, 90, 180]\n")
    )
    silent = run_json(*call)
    assert silent.get("sigma_z_mm") is None
    assert any("grey_noise" in note or "grey-noise" in note for note in silent["notes"])
    assert run_json(*call, "--grey-noise", 1.0)["sigma_z_mm"] > 0

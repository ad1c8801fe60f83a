"""``exposight decode --stereo``: images or codes of two cameras, from files to a cloud."""

import cv2
import numpy as np
import pytest

from exposight.cell import read_cloud

WIDTH, HEIGHT, FOCAL, BASELINE, DEPTH = 320, 240, 400.0, 60.0, 500.0
SEQUENCE = """name = "one fringe and one of 16"
projector_width = 512
projector_height = 384

[[columns.fringes]]
periods = 1
frames = [0, 1, 2]

[[columns.fringes]]
periods = 16
frames = [3, 4, 5]
"""


def info(path, offset_m=0.0, focal=FOCAL):
    k = [focal, 0, (WIDTH - 1) / 2, 0, focal, (HEIGHT - 1) / 2, 0, 0, 1]
    p = [*k[:3], -focal * offset_m, *k[3:6], 0.0, 0.0, 0.0, 1.0, 0.0]
    path.write_text(
        f"width: {WIDTH}\nheight: {HEIGHT}\ndistortion_model: plumb_bob\n"
        f"D: []\nK: {k}\nP: {p}\n", encoding="utf-8",
    )  # fmt: skip
    return path


def save(path, image):
    path.parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(path), image.clip(0, 255).round().astype(np.uint8))
    return path


@pytest.fixture
def cameras(tmp_path):
    left, right = info(tmp_path / "left.yaml"), info(tmp_path / "right.yaml", BASELINE / 1000)
    return ("--calibration", left, "--right-calibration", right)


@pytest.fixture
def pair(tmp_path):
    """A wall at 500 mm: every pixel moves by 48 px."""
    noise = cv2.GaussianBlur(np.random.default_rng(3).normal(size=(HEIGHT, WIDTH + 48)), (0, 0), 1)
    texture = 128.0 + 50.0 * noise / noise.std()
    return (
        save(tmp_path / "l.png", texture[:, :WIDTH]),
        save(tmp_path / "r.png", texture[:, 48:]),
    )


@pytest.fixture
def frames(tmp_path):
    """Of the same wall; the left camera sees projector column 0.6 u + 100."""
    folders = []
    u = np.tile(np.arange(WIDTH, dtype=float), (HEIGHT, 1))
    for name, moved in (("left", 0.0), ("right", 48.0)):
        column = 0.6 * (u + moved) + 100.0
        for i, periods in enumerate((1, 1, 1, 16, 16, 16)):
            phase = 2 * np.pi * (column * periods / 512 - i % 3 / 3)
            save(tmp_path / name / f"{i}.png", 120 + 80 * np.cos(phase))
        folders.append(tmp_path / name)
    (tmp_path / "s.toml").write_text(SEQUENCE, encoding="utf-8")
    return folders


@pytest.fixture
def failing(run):
    def invoke(*words, status=1):
        result = run("decode", *words)
        assert result.exit_code == status
        return result.stderr

    return invoke


def test_images_become_a_cloud(pair, cameras, tmp_path, run_json):
    out, shown = tmp_path / "c.ply", tmp_path / "p.png"
    words = ("--depth-limits", 300, 900, "-o", out, "--preview", shown)
    facts = run_json("decode", "--stereo", *pair, *cameras, *words)
    cloud = read_cloud(out)
    assert cloud.valid.shape == (HEIGHT, WIDTH)
    assert np.nanmedian(cloud.points[..., 2]) == pytest.approx(DEPTH, abs=0.3)
    assert cloud.n_valid > 0.7 * cloud.valid.size
    assert facts["points"] == cloud.n_valid
    assert facts["baseline_mm"] == pytest.approx(BASELINE)
    assert sum(row["count"] for row in facts["pixels"]) == cloud.valid.size
    assert cv2.imread(str(shown)).shape == (HEIGHT, WIDTH, 3)


def test_half_the_resolution(pair, cameras, tmp_path, run_json):
    words = ("--depth-limits", 300, 900, "--downsample", 2, "-o", tmp_path / "c.npy")
    run_json("decode", "--stereo", *pair, *cameras, *words)
    cloud = read_cloud(tmp_path / "c.npy")
    assert cloud.valid.shape == (HEIGHT // 2, WIDTH // 2)
    assert np.nanmedian(cloud.points[..., 2]) == pytest.approx(DEPTH, abs=1.0)
    # Pixel (u, v) of the cloud is the mean of the image's (2u, 2v) to (2u + 1, 2v + 1).
    x = cloud.points[60, 100, 0] / cloud.points[60, 100, 2] * FOCAL + (WIDTH - 1) / 2
    assert x == pytest.approx(200.5, abs=1e-3)


def test_codes_of_both_cameras_become_a_cloud(frames, cameras, tmp_path, run_json):
    words = ("-s", tmp_path / "s.toml", "-o", tmp_path / "c.npy")
    run_json("decode", "--stereo", *frames, *cameras, *words)
    cloud = read_cloud(tmp_path / "c.npy")
    assert np.nanmedian(abs(cloud.points[..., 2] - DEPTH)) < 1.0
    assert cloud.n_valid > 0.8 * (WIDTH - 48) * HEIGHT


def test_a_sensor_brings_cameras_and_limits(pair, tmp_path, cameras, run_json):
    sensor = tmp_path / "s.json"
    needed = ("--name", "s", "--exposures", 1, 9, "--working-distance", 300, 900)
    run_json("sensor", cameras[1], cameras[3], *needed, "-o", sensor)
    facts = run_json("decode", "--stereo", *pair, "--sensor", sensor)
    assert facts["depth_limits_mm"] == [300, 900]
    assert facts["depth_mm"]["median"] == pytest.approx(DEPTH, abs=0.3)


def test_swapped(pair, frames, cameras, tmp_path, failing):
    limits = ("--depth-limits", 300, 900)
    told = failing("--stereo", *reversed(pair), *cameras, *limits)
    assert "swapping both images fits" in told
    words = (*cameras, *limits, "-s", tmp_path / "s.toml")
    told = failing("--stereo", *reversed(frames), *words)
    assert "swapping both recordings fits" in told


def test_one_image_is_shifted(pair, cameras, tmp_path, failing):
    moved = save(tmp_path / "m.png", np.roll(cv2.imread(str(pair[1]), 0), 4, axis=0))
    told = failing("--stereo", pair[0], moved, *cameras, "--depth-limits", 300, 900)
    assert "4.0 px off its row" in told


def test_images_of_another_size(pair, cameras, tmp_path, failing):
    small = [save(tmp_path / f"s{p.name}", cv2.imread(str(p), 0)[::2, ::2]) for p in pair]
    told = failing("--stereo", *small, *cameras, "--depth-limits", 300, 900)
    assert "160 × 120 px" in told


def test_an_opencv_calibration_of_another_size(pair, tmp_path, failing):
    storage = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_WRITE)
    k = np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]])
    for name, node in {"M1": k, "D1": np.zeros((1, 5)), "M2": k, "D2": np.zeros((1, 5)),
                       "R": np.eye(3), "T": np.array([[-60.0], [0], [0]])}.items():  # fmt: skip
        storage.write(name, node)
    storage.release()
    words = ("-c", tmp_path / "c.yml", "--depth-limits", 300, 900)
    assert "principal point" in failing("--stereo", *pair, *words)


def test_no_point_is_an_error_that_says_why(pair, cameras, tmp_path, failing):
    dark = [save(tmp_path / f"d{p.name}", 0.05 * cv2.imread(str(p), 0)) for p in pair]
    told = failing("--stereo", *dark, *cameras, "--depth-limits", 300, 900)
    assert "no point" in told
    assert "longer exposure time" in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--stereo", "l.png", "r.png"), "--sensor or by --calibration"),
        (("--stereo", "l.png", "r.png", "-c", "left.yaml", "--right-calibration", "right.yaml"),
         "--depth-limits NEAR FAR"),
        (("--stereo", "l.png", "left", "--sensor", "rc-visard-65"), "one of each"),
        (("--stereo", "left", "right", "--sensor", "rc-visard-65"), "need --sequence"),
        (("--stereo", "l.png", "r.png", "-s", "board"), "two images need none"),
        (("left", "--stereo", "l.png", "r.png"), "without a folder"),
        (("--downsample", 2), "--stereo LEFT RIGHT"),
        (("left",), "--calibration and --sequence"),
        (("--stereo", "l.png", "r.png", "--sensor", "rc-visard-65", "--raw"), "go with --cal"),
    ],
)  # fmt: skip
def test_options_that_do_not_go_together(
    words, message, pair, frames, cameras, tmp_path, failing, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert message in failing(*words, status=2)


def test_a_sensor_with_one_camera(pair, failing):
    assert "has 1 camera" in failing("--stereo", *pair, "--sensor", "comet-pro-ae")

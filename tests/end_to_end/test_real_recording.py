"""decode, info and demo on a recorded object."""

import pytest

from exposight.cell import read_cloud


@pytest.fixture(scope="module")
def skull(real_data):
    folder = real_data / "skull"
    if not folder.is_dir():
        pytest.skip("the skull recording is not there")
    return folder


def decoding(skull, *more):
    calibration = skull / "calibration.xml"
    return ("decode", skull / "skull_2x3", "-c", calibration, "-s", "skull_2x3", *more)


def test_decode_gives_the_cloud(skull, tmp_path, run_json):
    path = tmp_path / "cloud.ply"
    document = run_json(*decoding(skull, "-o", path, "--depth-limits", 300, 2000))
    cloud = read_cloud(path)
    assert cloud.n_valid == document["points"] == document["pixels"][0]["count"]
    assert cloud.valid.shape == tuple(document["size_px"][::-1]) == (1352, 1688)
    assert document["points"] > 300_000
    assert 350 < document["depth_mm"]["median"] < 450


def test_decode_prints_its_counts_and_a_preview(skull, tmp_path, run, run_json):
    preview = tmp_path / "preview.png"
    result = run(*decoding(skull, "--preview", preview))
    assert result.exit_code == 0
    assert "low modulation" in result.stdout
    assert run_json("info", preview)["size_px"] == [2 * 1688, 1352]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--min-modulation", 200), "no point: none of 2 282 176 pixels was decoded; the patterns"),
        (("--depth-limits", 0.3, 2), "mm: 0 are nearer and 360 802 farther, from 325"),
    ],
)
def test_decode_without_a_point_says_why(skull, run, options, reason):
    result = run(*decoding(skull, *options))
    assert result.exit_code == 1
    assert reason in result.stderr.replace("\u202f", " ").replace("\xa0", " ")


def test_decode_says_that_it_wrote_nothing(skull, tmp_path, run):
    assert "nothing was written: --output" in run(*decoding(skull)).stdout
    kept = run(*decoding(skull, "--output", tmp_path / "cloud.ply"))
    assert "nothing was written" not in kept.stdout


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (("--depth-limits", 2000, 300), 2, "NEAR < FAR in mm, got 2000 300"),
        (("--min-modulation", 300), 1, "at most 255, where grey levels end"),
    ],
)
def test_decode_refuses_senseless_limits(skull, run, options, status, message):
    result = run(*decoding(skull, *options, "--json"))
    assert result.exit_code == status
    assert message in result.stdout


def test_decode_needs_every_frame(skull, tmp_path, run):
    for frame in (0, 1, 2, 4, 5):
        name = f"frameSeq_0{frame}.png"
        (tmp_path / name).symlink_to(skull / "skull_2x3" / name)
    calibration = skull / "calibration.xml"
    result = run("decode", tmp_path, "-c", calibration, "-s", "skull_2x3")
    assert result.exit_code == 1
    assert "expected 6 frames, found 5; the numbering skips 3" in result.stderr


def test_info_recognises_frames_and_calibration(skull, run_json):
    assert run_json("info", skull / "skull_2x3")["fitting_sequences"] == ["skull_2x3"]
    calibration = run_json("info", skull / "calibration.xml")
    assert calibration["kind"] == "calibration"
    assert calibration["projector_size_px"] == [1824, 1140]

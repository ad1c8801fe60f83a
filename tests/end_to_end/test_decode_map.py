"""Frames to a decoded map, by the command line, without a calibration."""

import cv2
import numpy as np
import pytest

from exposight.imaging import (
    AxisCoding,
    GrayCode,
    PatternSequence,
    read_map,
    sequence_to_toml,
)

SEQUENCE = PatternSequence(
    name="seven bits", projector_width=128, projector_height=96, white_frame=0, black_frame=1,
    columns=AxisCoding(gray_code=GrayCode(frames=tuple(range(2, 9)))),
)  # fmt: skip


@pytest.fixture
def recording(tmp_path):
    """Frames of a surface that sees two camera px for each projector column, and its edge dark."""
    column = np.arange(200) // 2
    frames = np.zeros((SEQUENCE.n_frames, 40, 200), dtype=np.uint8)
    for frame, lit in SEQUENCE.slides().items():
        frames[frame] = 20 + 180 * (lit.ravel()[column] if lit.size > 1 else lit.item())
    frames[:, :5] = 20
    for i, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / f"frame_{i}.png"), frame)
    (tmp_path / "sequence.toml").write_text(sequence_to_toml(SEQUENCE), encoding="utf-8")
    return tmp_path


def test_a_map_needs_no_calibration(recording, run_json):
    path = recording / "map.npz"
    document = run_json("decode", recording, "-s", recording / "sequence.toml", "--map", path)
    assert document["decoded"] == 35 * 200
    decoded = read_map(path)
    assert np.isnan(decoded.column[:5]).all()
    error = decoded.column[5:] - (np.arange(200) / 2 - 0.25)
    assert np.abs(error).max() <= 0.5
    assert decoded.row is None
    known = run_json("info", path)
    assert (known["kind"], known["decoded"]) == ("decoded map", 35 * 200)


def test_a_cloud_does(recording, run):
    result = run(
        *("decode", recording, "-s", recording / "sequence.toml"),
        *("--map", recording / "map.npz", "-o", recording / "cloud.ply"),
    )
    assert result.exit_code == 2
    assert "--output needs --calibration" in result.stderr
    assert not (recording / "map.npz").exists()


def test_a_map_is_an_archive(recording, run):
    result = run("decode", recording, "-s", "board", "--map", recording / "map.png")
    assert result.exit_code == 2
    assert ".npz" in result.stderr

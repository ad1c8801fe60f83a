"""Wrong calls and failures: exit status, one line for people, one JSON object for machines."""

import json
import tempfile

import pytest


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("train",), "OBSERVATIONS is missing"),
        (("train", "o.csv", "--restart", "3"), "Did you mean --restarts?"),
        (("train", "o.csv", "--seed", "one"), "--seed"),
        (("train", "o.csv", "--restarts", "0"), "Must be > 0"),
        (("split", "o.csv", "--by", "features"), 'Did you mean "feature"?'),
        (("observe", "--cloud-unit", "mmm"), '"mm", "cm", "m"'),
        (("observe",), "give a campaign's folder"),
        (("observe", "folder", "--exposure-ms", "3"), "not both"),
        (("observe", "--image", "a.png", "--exposure-ms", "3"), "also needs --cloud"),
        (("predict", "m.exposight-model"), "give a table of observations"),
        (("evaluate", "q.exposight-model"), "the observations are missing"),
        (("evaluate", "o.csv", "q.exposight-model"), "the observations, o.csv, come last"),
        (("evaluate", "o.csv"), "the models are missing"),
        (("decode", ".", "-c", "c.xml", "-s", "board", "--depth-limits", 9, 3), "NEAR < FAR"),
        (("reproduce", "--sensors", "tof"), '"structured-light", "stereo"'),
        (("trian",), "did you mean 'train'?"),
        (("--loud", "train"), "unknown option --loud"),
    ],
)
def test_a_wrong_call_ends_with_status_two(words, message, run):
    ended = run(*words)
    assert (ended.exit_code, ended.stdout) == (2, "")
    first, second = ended.stderr.splitlines()
    assert first.startswith("error: ")
    assert message in first
    assert "--help" in second
    for_machines = run(*words, "--json")
    assert (for_machines.exit_code, for_machines.stderr) == (2, "")
    error = json.loads(for_machines.stdout)["error"]
    assert error["type"] == "UsageError"
    assert f"error: {error['message']}" == first


def test_a_failure_is_one_line_or_one_json_object(tmp_path, run):
    path = tmp_path / "none.csv"
    message = f"{path}: no such observation table"
    ended = run("train", path)
    assert (ended.exit_code, ended.stdout) == (1, "")
    assert ended.stderr == f"error: {message}\n"
    ended = run("train", path, "--json")
    assert (ended.exit_code, ended.stderr) == (1, "")
    assert json.loads(ended.stdout) == {"error": {"type": "MissingFileError", "message": message}}


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("simulate", "smal"), "'small'"),
        (("info", "stereo_x"), "'stereo-x'"),
        (("train", "o.csv", "-m", "q-k4"), "'q_k4'"),
        (("decode", ".", "-c", "c.xml", "-s", "skull2x3"), "'skull_2x3'"),
    ],
)
def test_names_that_are_nearly_right_are_suggested(words, meant, run):
    assert f"did you mean {meant}?" in run(*words).stderr


class Raising:
    """Raises when it is looked through."""

    def __init__(self, error):
        self._error = error

    def __iter__(self):
        raise self._error


def test_a_fault_of_exposight_is_told_in_a_line_and_kept_in_a_file(tmp_path, monkeypatch, run):
    monkeypatch.setattr("exposight.cli.info.KINDS", Raising(KeyError("no such thing")))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    ended = run("info", __file__, "--json")
    assert ended.exit_code == 70
    error = json.loads(ended.stdout)["error"]
    assert error["type"] == "InternalError"
    assert "a fault of exposight" in error["message"]
    (kept,) = tmp_path.glob("exposight-fault-*.txt")
    assert str(kept) in error["message"]
    assert "Traceback" in kept.read_text()
    assert "no such thing" in kept.read_text()


def test_too_little_memory_is_no_fault(monkeypatch, run):
    monkeypatch.setattr("exposight.cli.info.KINDS", Raising(MemoryError("cannot have 18 GiB")))
    ended = run("info", __file__)
    assert ended.exit_code == 1
    assert "18 GiB" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1

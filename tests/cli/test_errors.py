"""Wrong calls for machines: one JSON object, like every other error."""

import json

import pytest


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("train", "--json"), "Missing argument 'OBSERVATIONS'."),
        (("train", "o.csv", "--jsn", "--json"), "No such option: --jsn"),
        (("train", "o.csv", "--seed", "one", "--json"), "Invalid value for '--seed'"),
        (("split", "o.csv", "--by", "colour", "--json"), "'feature', 'view', 'row'"),
        (("observe", "--json"), "give a campaign's folder"),
        (("lern", "--json"), "No such command 'lern'."),
        (("--loud", "train", "--json"), "No such option: --loud"),
        (("reproduce", "--sensor", "tof", "--json"), "structured-light, stereo, both"),
    ],
)
def test_a_wrong_call_is_one_json_object(words, message, run):
    result = run(*words)
    assert result.exit_code == 2
    assert result.stderr == ""
    error = json.loads(result.stdout)["error"]
    assert error["type"] == "UsageError"
    assert message in error["message"]


def test_a_missing_file_is_one_json_object(tmp_path, run):
    result = run("train", tmp_path / "none.csv", "--json")
    assert result.exit_code == 1
    error = json.loads(result.stdout)["error"]
    assert error == {
        "type": "MissingFileError",
        "message": f"{tmp_path / 'none.csv'}: no such observation table",
    }


def test_people_see_the_form_of_the_call(run):
    result = run("train")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "Usage: exposight train" in result.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("split", "o.csv", "--by", "features"), "'row'; did you mean 'feature'?"),
        (("observe", "--cloud-unit", "mmm"), "did you mean 'mm'?"),
        (("split", "o.csv", "--seed", "x"), "Invalid value for '--seed': expected a whole number"),
        (("split", "o.csv", "--share", "x"), "Invalid value for '--share': expected a number"),
    ],
)
def test_a_value_that_cannot_be_says_what_was_expected(words, message, run):
    told = json.loads(run(*words, "--json").stdout)["error"]["message"]
    assert message in told
    assert "Value error" not in told

"""What somebody may have meant."""

import pytest


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("trian",), "'train'"),
        (("simulate", "smal"), "'small'"),
        (("info", "stereo_x"), "'stereo-x'"),
        (("train", "o.csv", "-m", "q-k4"), "'q_k4'"),
        (("train", "o.csv", "-m", "al"), "'all'"),
        (("decode", ".", "-c", "c.xml", "-s", "skull2x3"), "'skull_2x3'"),
        (("reproduce", "--sensor", "sterio"), "'stereo'"),
    ],
)
def test_commands_suggest_what_they_know(words, meant, run):
    result = run(*words)
    told = " ".join(result.stderr.replace("│", " ").split())
    assert f"id you mean {meant}?" in told
    assert result.stdout == ""


def test_an_option_that_is_nearly_right(run):
    told = " ".join(run("train", "o.csv", "--restart", "3").stderr.replace("│", " ").split())
    assert "No such option: --restart" in told
    assert "--restarts" in told

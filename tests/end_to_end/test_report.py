"""``exposight report``: one page of a campaign or table and of models."""

import pytest


@pytest.mark.parametrize("source", ["campaign", "observations"])
def test_it_writes_a_page(source, request, models, tmp_path, run_json):
    files = sorted(models.iterdir())
    told = run_json("report", request.getfixturevalue(source), *files, "-o", tmp_path / "page")
    assert told["observations"] == 234
    assert [line["model"] for line in told["scores"]] == ["e_k4", "q_k4", "q_k4+e_k4"]
    (file,) = told["files"]
    assert file == {"kind": "report", "path": str(tmp_path / "page/report.html"), "replaced": False}
    assert "q_k4" in (tmp_path / "page" / "report.html").read_text("utf-8")


def test_something_else_than_a_campaign(models, tmp_path, run):
    ended = run("report", sorted(models.iterdir())[0], "-o", tmp_path)
    assert ended.exit_code == 1
    assert ended.stderr.startswith("error: ")

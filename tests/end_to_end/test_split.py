"""``exposight split``: what trains and what tests."""

import polars as pl
import pytest

from exposight.observing import read_observations


@pytest.fixture(scope="module")
def split(observations, run_json, tmp_path_factory):
    """Split the plate's table, and return the document and both tables."""

    def invoke(*words):
        folder = tmp_path_factory.mktemp("split")
        told = run_json("split", observations, "-o", folder, *words)
        return told, *(read_observations(folder / f"{side}.csv") for side in ("train", "test"))

    return invoke


def test_no_feature_is_on_both_sides(split):
    told, train, test = split("--by", "feature", "--test-share", 0.25)
    assert not set(train.names("feature")) & set(test.names("feature"))
    assert told["test_features"] == sorted(set(test.names("feature")))
    assert [side["rows"] for side in told["sides"]] == [len(train), len(test)]


def test_no_view_is_on_both_sides(split):
    _, train, test = split("--by", "view", "--test-share", 0.3)
    assert not set(train.names("view")) & set(test.names("view"))
    assert set(train.names("feature")) == set(test.names("feature"))


def test_rows_are_counted_as_in_the_paper(split, observations):
    _, train, test = split("--by", "row", "--test-share", 0.2)
    assert len(train) == int(0.8 * len(read_observations(observations)))
    assert len(train) + len(test) == 234


def test_every_row_is_on_one_side_as_it_was(split, observations):
    _, train, test = split("--by", "view", "--test-share", 0.5)
    whole = read_observations(observations).frame
    both = pl.concat([train.frame, test.frame])
    keys = ["feature", "view", "exposure_ms"]
    assert both.sort(keys).equals(whole.sort(keys))


def test_the_seed_decides(split):
    words = ("--by", "feature", "--test-share", 0.4, "--seed")
    first, again, other = (split(*words, seed)[2] for seed in (1, 1, 5))
    assert first.frame.equals(again.frame)
    assert set(first.names("feature")) != set(other.names("feature"))


def test_parquet_stays_parquet(observations, run_json, tmp_path):
    path = tmp_path / "o.parquet"
    read_observations(observations).write(path)
    told = run_json("split", path, "-o", tmp_path)
    assert told["files"][0]["path"] == str(tmp_path / "train.parquet")


def test_people_are_told_what_tests_and_what_comes_next(observations, run, tmp_path):
    shown = run("split", observations, "-o", tmp_path / "a b", "--test-share", 0.1).stdout
    test = read_observations(tmp_path / "a b" / "test.csv")
    assert test.names("feature")[0] in shown
    assert f"next: exposight train '{tmp_path}/a b/train.csv'" in shown


def test_rows_split_at_random_flatter(observations, run, tmp_path):
    shown = run("split", observations, "-o", tmp_path, "--by", "row").stdout
    assert "note: test rows have near copies among the training rows" in shown


def test_an_empty_side_is_refused(observations, run, tmp_path):
    result = run("split", observations, "-o", tmp_path / "out", "--by", "view", "--test-share", 0.9)
    assert result.exit_code == 1
    assert "a share of 0.1 of 3 views leaves no view to train" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_table_of_one_feature_cannot_be_split_by_features(observations, run, tmp_path):
    path = tmp_path / "one.csv"
    table = read_observations(observations)
    table.where(table.names("feature") == "h01").write(path)
    result = run("split", path, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert "a share of 0.8 of 1 feature leaves no feature to train or none to test" in result.stderr


def test_a_side_without_a_measured_row_is_refused(observations, run, tmp_path):
    path = tmp_path / "two.csv"
    table = read_observations(observations)
    names = table.names("feature")
    table.where((names == "far") | (names == "h01")).write(path)
    result = run("split", path, "-o", tmp_path / "out", "--test-share", 0.5)
    assert result.exit_code == 1
    assert "hold no measured observation; choose another seed or share" in result.stderr


@pytest.mark.parametrize("share", [0, 1, -0.1, 20])
def test_a_share_that_is_none(share, observations, run, tmp_path):
    result = run("split", observations, "-o", tmp_path, "--test-share", share)
    assert result.exit_code == 2
    assert "--test-share" in result.stderr

"""Splits: every row on one side, whole groups together, boxes; and what they refuse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import InputError, ObservationError
from exposight.statistics import inside_box, random_split, split_by_group

seeds = st.integers(0, 10_000)
laws = settings(max_examples=30, deadline=None)


# Sizes of the paper: Sect. 3.2.2 and Table 9.
@pytest.mark.parametrize(("n", "train"), [(1140, 912), (527, 421), (948, 758), (2421, 1936)])
def test_the_papers_sizes(n, train):
    split = random_split(n, 0.8, np.random.default_rng(0))
    assert len(split.train) == train
    assert len(split.test) == n - train


def test_a_share_that_rounding_falls_short_of_is_met():
    assert len(random_split(100, 0.29, np.random.default_rng(0)).train) == 29


@laws
@given(n=st.integers(2, 200), seed=seeds)
def test_every_row_is_on_one_side(n, seed):
    train, test = random_split(n, 0.5, np.random.default_rng(seed))
    np.testing.assert_array_equal(np.sort(np.concatenate([train, test])), np.arange(n))


@laws
@given(groups=st.lists(st.sampled_from("abcde"), min_size=2, max_size=60), seed=seeds)
def test_groups_stay_together(groups, seed):
    if len(set(groups)) < 2:
        return
    labels = np.array(groups)
    train, test = split_by_group(groups, 0.6, np.random.default_rng(seed))
    assert not set(labels[train]) & set(labels[test])
    np.testing.assert_array_equal(np.sort(np.concatenate([train, test])), np.arange(len(groups)))
    assert len(set(labels[train])) == int(0.6 * len(set(groups)) + 1e-9)


def test_the_same_seed_gives_the_same_split():
    one, other = (random_split(50, 0.8, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.train, other.train)


def test_other_seeds_give_other_splits():
    one, other = (split_by_group(np.arange(50), 0.8, np.random.default_rng(s)) for s in (0, 1))
    assert set(one.train) != set(other.train)


def test_the_box_includes_its_faces():
    train = np.array([[0.0, -5.0], [10.0, 5.0]])
    query = np.array([[0.0, 5.0], [10.1, 0.0], [5.0, -5.1], [5.0, 0.0]])
    np.testing.assert_array_equal(inside_box(train, query), [True, False, False, True])


@laws
@given(seed=seeds)
def test_training_rows_are_inside_their_own_box(seed):
    x = np.random.default_rng(seed).normal(size=(20, 3))
    assert inside_box(x, x).all()


def test_an_empty_query_is_an_empty_mask():
    assert inside_box(np.ones((2, 3)), np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, float("nan")])
def test_a_share_outside_0_to_1_is_refused(share):
    with pytest.raises(InputError, match="share must lie between 0 and 1"):
        random_split(10, share, np.random.default_rng(0))


def test_a_split_that_leaves_a_side_empty_is_refused():
    with pytest.raises(ObservationError, match=r"share of 0\.8 of 1 groups leaves a side empty"):
        split_by_group(["a", "a"], 0.8, np.random.default_rng(0))


def test_groups_must_be_a_vector():
    with pytest.raises(ObservationError, match=r"one label for each observation, got shape \(1, 2"):
        split_by_group([["a", "b"]], 0.5, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("train", "query", "message"),
    [
        (np.ones((2, 3)), np.ones((2, 2)), r"the same columns, .* \(2, 3\) and \(2, 2\)"),
        (np.empty((0, 2)), np.ones((2, 2)), "train at least one row"),
        (np.ones(3), np.ones((2, 3)), r"train must be a finite matrix .* got shape \(3,\)"),
        ([[0.0, np.nan]], [[0.0, 1.0]], "train must be a finite matrix"),
        ([[0.0]], [["a"]], "query must be an array of numbers"),
    ],
)
def test_a_malformed_box_is_refused(train, query, message):
    with pytest.raises(ObservationError, match=message):
        inside_box(train, query)

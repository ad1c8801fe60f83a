"""Table 9's datasets: rows, filters, splits."""

from collections.abc import Callable

import numpy as np
import pytest

from exposight.observing import ObservationTable
from exposight.paper import Dataset, StudySettings
from exposight.paper.datasets import DATASETS, POSE, POSITION, build_dataset, inside_range

INSIDE = (*(f"f{i}" for i in range(1, 10)), *(f"f{i}_test" for i in range(1, 5)))


@pytest.fixture
def build(observe: Callable[..., ObservationTable]) -> Callable[..., Dataset]:
    tables = {"inside": observe(INSIDE), "finer": observe(INSIDE[:9], views=2)}

    def build_one(name: str, **settings: object) -> Dataset:
        (definition,) = (own for own in DATASETS if own.name == name)
        return build_dataset(definition, tables, StudySettings(**settings))

    return build_one


def test_x_has_the_four_training_features(build: Callable[..., Dataset]) -> None:
    assert set(build("X").table.names("feature")) == {"f1", "f2", "f3", "f4"}


def test_x_has_all_its_rows(build: Callable[..., Dataset]) -> None:
    assert len(build("X").table) == 4 * 6 * 5


def test_x_test_has_the_unseen_features_only(build: Callable[..., Dataset]) -> None:
    assert set(build("X_test").table.names("feature")) == {f"f{i}_test" for i in range(1, 5)}


def test_exposure_datasets_keep_good_rows_only(build: Callable[..., Dataset]) -> None:
    good = build("X").table.array(["p_norm"])[:, 0] >= 0.75
    kept = build("eX").table
    assert len(kept) == good.sum()
    assert kept.array(["p_norm"]).min() >= 0.75


def test_the_finer_campaign_is_added(build: Callable[..., Dataset]) -> None:
    assert len(build("eX_plusplus").table) > len(build("eX_plus").table)


def test_rows_that_were_not_measured_are_left_out(
    observe: Callable[..., ObservationTable],
) -> None:
    table = observe(INSIDE)
    frame = table.frame.to_dicts()
    frame[0] |= {"p_norm": None, "i_avg": None, "visibility": "out of frame"}
    hidden = ObservationTable(frame=type(table.frame)(frame, schema=table.frame.schema))
    dataset = build_dataset(DATASETS[0], {"inside": hidden}, StudySettings())
    assert len(dataset.table) == 4 * 6 * 5 - 1


def test_four_fifths_train_rounded_down(build: Callable[..., Dataset]) -> None:
    dataset = build("eX")
    n = len(dataset.table)
    assert (len(dataset.train), len(dataset.validation)) == (int(0.8 * n), n - int(0.8 * n))


def test_a_fifth_of_the_stereo_rows_trains(observe: Callable[..., ObservationTable]) -> None:
    (definition,) = (own for own in DATASETS if own.name == "s2_X")
    dataset = build_dataset(definition, {"stereo-inside": observe(INSIDE)}, StudySettings())
    assert len(dataset.train) == 120 // 5


def test_both_sides_of_the_split_are_the_dataset(build: Callable[..., Dataset]) -> None:
    dataset = build("X")
    keys = ["feature", "view", "exposure_ms"]
    sides = [*dataset.train.frame[keys].rows(), *dataset.validation.frame[keys].rows()]
    assert sorted(sides) == sorted(dataset.table.frame[keys].rows())


def test_no_view_is_on_both_sides_of_the_split_by_view(build: Callable[..., Dataset]) -> None:
    dataset = build("X")
    train, validation = (
        set(side.names("view")) for side in (dataset.train_by_view, dataset.validation_by_view)
    )
    assert train
    assert validation
    assert not train & validation


def test_the_random_split_shares_views(build: Callable[..., Dataset]) -> None:
    dataset = build("X")
    assert set(dataset.train.names("view")) & set(dataset.validation.names("view"))


@pytest.mark.parametrize(("seed", "same"), [(1, True), (2, False)])
def test_the_split_follows_from_the_seed(
    build: Callable[..., Dataset], seed: int, same: bool
) -> None:
    first, other = build("X", seed=1).train.frame, build("X", seed=seed).train.frame
    assert first.equals(other) == same


def test_unseen_features_are_not_split(build: Callable[..., Dataset]) -> None:
    assert build("X_test").train is None


def test_a_dataset_without_its_campaign_is_empty(build: Callable[..., Dataset]) -> None:
    dataset = build("X_out")
    assert (len(dataset.table), dataset.train) == (0, None)


def test_inside_is_judged_by_whole_degrees(observe: Callable[..., ObservationTable]) -> None:
    # Training rows have w = 5.00 … 5.01 and p = −2.0 … −1.8; the query's p ends at −1.6.
    train, query = observe(["f1", "f2"]), observe(["f1", "f2", "f3"])
    turned = inside_range(train, query, ("w_deg", "p_deg"))
    assert turned.all()


def test_inside_needs_every_column(observe: Callable[..., ObservationTable]) -> None:
    train = observe(["f1"], views=2)
    query = observe(["f1"], views=3)  # the third is in the far plane
    by_hand = query.array(["z_mm"])[:, 0] < 0
    assert np.array_equal(inside_range(train, query, ("z_mm", "w_deg")), by_hand)
    assert not inside_range(train, query, POSE)[~by_hand].any()
    assert set(POSITION) < set(POSE)

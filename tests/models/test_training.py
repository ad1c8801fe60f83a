"""Training many models at once: in parallel, in order, and the same for any number of workers."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.errors import InputError, ObservationError
from exposight.models import (
    Training,
    load_model,
    model_named,
    run_trainings,
    save_model,
    train_all,
)

SPECIFICATIONS = tuple(map(model_named, ("q_k1", "e_k1", "q_k2")))


def train_one(specification, table, *, cluster=None, **settings):
    training = Training(specification=specification, table=table, **settings)
    return training.run(cluster=cluster)


def train(table, specifications=SPECIFICATIONS, **settings):
    return train_all(specifications, table, seed=3, restarts=1, **settings)


@pytest.mark.slow
def test_models_are_the_same_for_any_number_of_workers(table):
    for one, other in zip(train(table), train(table, workers=2), strict=True):
        assert one.name == other.name
        assert one.summary == other.summary
        np.testing.assert_array_equal(one.predict(table).mean, other.predict(table).mean)


def test_models_come_in_the_order_asked_for(table):
    assert [model.name for model in train(table)] == [each.name for each in SPECIFICATIONS]


def test_progress_counts_models_and_starts(table):
    steps = []
    train(table, SPECIFICATIONS[:2], progress=lambda *step: steps.append(step))
    assert [step[1:] for step in steps if step[0] == "training models"] == [(0, 2), (1, 2), (2, 2)]
    assert ("training q_k1", 1, 1) in steps


def test_the_longest_training_begins_first(table):
    short, long = (
        Training(specification=SPECIFICATIONS[0], table=rows, seed=1, restarts=1)
        for rows in (table.where(np.arange(len(table)) < 30), table)
    )
    assert [training for training, _ in run_trainings([short, long])] == [long, short]


def test_a_table_that_one_model_cannot_learn_from_is_refused(make_table):
    table = make_table(200)
    poor = table.where(table.array(["p_norm"])[:, 0] < 0.75)
    with pytest.raises(ObservationError, match="cannot train e_k1"):
        train(poor, SPECIFICATIONS[:2])


def test_processes_here_and_a_cluster_exclude_each_other(table):
    with pytest.raises(InputError, match="choose one"):
        train(table, workers=2, cluster="tcp://127.0.0.1:8786")


# -- committees ---------------------------------------------------------------------------------


def test_many_rows_train_a_committee_that_is_kept_with_its_model(make_table, tmp_path):
    table, unseen = make_table(300), make_table(50, seed=2)
    specification = model_named("q_k1")
    committee, exact = (
        train_one(specification, table, seed=1, restarts=1, committee_rows=rows)
        for rows in (120, None)
    )
    assert committee.experts > exact.experts == 1
    assert committee.n_observations == exact.n_observations == len(table)
    gap = np.abs(committee.predict(unseen).mean - exact.predict(unseen).mean)
    assert gap.max() < 0.02
    path = tmp_path / "q_k1.exposight-model"
    save_model(path, committee)
    again = load_model(path)
    np.testing.assert_array_equal(again.predict(unseen).mean, committee.predict(unseen).mean)
    assert again.summary == committee.summary
    with pytest.raises(InputError, match="committee"):
        committee.with_observations(unseen)


def test_rows_up_to_the_limit_are_trained_exactly(table):
    training = Training(specification=SPECIFICATIONS[0], table=table, seed=1)
    assert not training.needs_committee
    assert replace(training, committee_rows=len(table) - 1).needs_committee


def test_no_specifications_give_no_models(table):
    assert train(table, ()) == ()


@pytest.mark.slow
def test_a_cluster_trains_the_same_models(make_table):
    distributed = pytest.importorskip("distributed")
    table, settings = make_table(400), {"seed": 1, "restarts": 1, "committee_rows": 150}
    here = train_one(SPECIFICATIONS[0], table, **settings)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        shards = train_one(SPECIFICATIONS[0], table, cluster=address, **settings)
        whole = train_all(SPECIFICATIONS[:2], table, cluster=address, **settings)[0]
    for model in (shards, whole):
        assert model.summary == here.summary
        np.testing.assert_array_equal(model.predict(table).mean, here.predict(table).mean)

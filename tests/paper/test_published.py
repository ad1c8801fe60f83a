"""The paper's figures in the package."""

from exposight.paper.ladder import LADDER
from exposight.paper.published import (
    published_datasets,
    published_hyperparameters,
    published_scores,
)


def test_table_2_gives_the_four_inputs_on_unseen_features() -> None:
    score = published_scores()["q_k4", "X4_test", "f1-4_test"]
    assert (score.table, score.r2_percent, score.mse, score.rmse) == (2, 92.74, 0.011, 10.49)


def test_table_8_gives_the_product_of_both_variances() -> None:
    assert published_hyperparameters()["e_k6", "variance", ""] == 66 * 331


def test_table_9_gives_counts_and_ranges() -> None:
    near = published_datasets()["X near"]
    assert (near.n, near.ranges["z_mm"]) == (390, (-188.0, -149.0))


def test_table_9_says_how_many_train() -> None:
    known = {name: own.n_train for name, own in published_datasets().items() if own.n_train}
    assert known == {"X": 912, "eX": 421, "eX_plus": 758, "eX_plusplus": 1936, "s2_X": 2693}


def test_every_line_of_the_papers_tables_has_its_rung() -> None:
    ours = {
        (rung.name, line.paper_dataset, line.paper_features)
        for rung in LADDER
        for line in rung.evaluations
    }
    assert set(published_scores()) <= ours


def test_every_line_stands_in_the_papers_table() -> None:
    published = published_scores()
    for rung in LADDER:
        for line in rung.evaluations:
            score = published.get((rung.name, line.paper_dataset, line.paper_features))
            assert score is None or score.table == line.table


def test_every_rung_has_hyperparameters_in_table_8() -> None:
    assert {rung.name for rung in LADDER} == {rung for rung, _, _ in published_hyperparameters()}

import numpy as np
import pytest

from exposight.planning.lookahead import served_between

SETTINGS = np.geomspace(1.0, 500.0, 96)
WINDOWS = np.tile([200.0, 300.0], (256, 1))
"""Where the models believe the window to be: wrongly."""


def drawn(tries):
    return served_between(WINDOWS, SETTINGS, tries, np.random.default_rng(1))


def test_a_window_lies_between_too_dark_and_clipped():
    served = drawn([(21.0, "dark"), (150.0, "clips")])
    inside = (SETTINGS > 21.0) & (SETTINGS < 150.0)
    chance = served.mean(axis=0)
    assert chance[~inside].max() == 0.0
    assert chance[inside].max() > 0.05
    middle = np.argmin(np.abs(np.log(SETTINGS / np.sqrt(21.0 * 150.0))))
    assert chance[middle] > 0.7 * chance.max()


def test_every_further_miss_makes_it_less_likely():
    few = drawn([(21.0, "dark"), (150.0, "clips")])
    more = drawn([(21.0, "dark"), (22.0, "dark"), (140.0, "clips"), (150.0, "clips")])
    assert more.mean() < 0.6 * few.mean()


@pytest.mark.parametrize(
    "tries",
    [
        [],
        [(21.0, "dark")],
        [(150.0, "clips")],
        [(21.0, "clips"), (150.0, "dark")],
        [(21.0, ""), (150.0, "")],
    ],
)
def test_what_says_nothing_of_a_window_between(tries):
    assert drawn(tries) is None

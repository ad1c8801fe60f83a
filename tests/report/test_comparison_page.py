"""Labels of the figure of strategies."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from exposight.report.comparison_page import _apart


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20).map(sorted))
def test_labels_keep_their_order_and_do_not_touch(wishes):
    gap = 0.04
    places = _apart(wishes, gap)
    assert (np.diff(places) >= gap - 1e-9).all()
    assert min(places) >= -1e-9
    assert max(places) <= 1.0 + 1e-9


def test_labels_that_have_room_stay_where_they_are():
    assert _apart([0.1, 0.5, 0.9], 0.04) == [0.1, 0.5, 0.9]

"""Strategies on sweeps whose best answer is known."""

from itertools import combinations

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.errors import FormatError, InputError, ObservationError
from exposight.observing import ObservationTable
from exposight.planning import CaptureCosts, ExposureLimits
from exposight.planning.comparing.comparison import compare
from exposight.planning.comparing.comparison_files import read_comparison, write_comparison
from exposight.planning.comparing.strategies import STRATEGIES, Trial, strategies_named, strategy
from exposight.planning.comparing.strategies.clusters import means
from exposight.planning.comparing.strategies.oracle import least_cover
from exposight.planning.comparing.sweeps import Sweep

TIMES_MS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
LOW, HIGH = 20.0, 120.0
RIVALS = [name for name, each in STRATEGIES.items() if each.kind == "rival"]


def sweep_table(lights, times_ms=TIMES_MS, stack=True) -> ObservationTable:
    """Features with so many grey levels per ms in each view; good between `LOW` and `HIGH`."""
    rows = [
        {"view": view, "feature": f"f{i}", "exposure_ms": t, "grey": light * t}
        for view, of_view in lights.items()
        for i, light in enumerate(of_view)
        for t in times_ms
    ]
    grey = pl.col("grey")
    levels = {f"i_max_p{p:02d}": grey.clip(upper_bound=255.0) for p in (5, 25, 50, 75, 95)}
    levels |= {f"i_mod_p{p:02d}": 0.9 * grey.clip(upper_bound=255.0) for p in (5, 25, 50, 75, 95)}
    frame = pl.DataFrame(rows).with_columns(
        p_norm=pl.when(grey.is_between(LOW, HIGH)).then(1.0).otherwise(0.0),
        i_avg=grey.clip(upper_bound=255.0),
        clipped_share=(grey > 255.0).cast(pl.Float64),
        **dict.fromkeys(("x_mm", "y_mm", "z_mm", "w_deg", "p_deg", "r_deg"), pl.lit(0.0)),
        radius_mm=pl.lit(5.0),
        **(levels if stack else {}),
    )
    return ObservationTable.from_frame(frame.drop("grey"))


@pytest.fixture
def sweep() -> Sweep:
    """One view that one capture serves, and one that takes two."""
    return Sweep.of(sweep_table({"one": (1.0, 2.0, 3.0), "two": (0.5, 1.0, 16.0)}))


def row_of(comparison, name):
    return comparison.scores.row(by_predicate=pl.col("strategy") == name, named=True)


def test_the_oracle_takes_the_fewest_captures(sweep):
    scores = row_of(compare(sweep, []), "oracle")
    assert (scores["covered_share"], scores["exposures"]) == (1.0, 1.5)
    assert (scores["exposures_over_oracle"], scores["all_had_share"]) == (1.0, 1.0)


def test_among_the_fewest_captures_the_oracle_takes_the_quickest(sweep):
    outcomes = compare(sweep, []).frame
    # 3.0 · t ≤ 120 and 1.0 · t ≥ 20: 32 ms alone; then 4 ms for the light of 16, 64 ms for 0.5
    assert outcomes["captures_ms"].to_list() == [[32.0], [2.0, 64.0]]
    assert outcomes["time_s"].to_list() == pytest.approx([0.884, 1.792])


@given(
    st.lists(st.lists(st.booleans(), min_size=5, max_size=5), min_size=1, max_size=6),
    st.lists(st.floats(0.1, 9.0), min_size=5, max_size=5),
)
@settings(max_examples=60, deadline=None)
def test_least_cover_is_that_of_trying_all(serves, costs):
    serves, costs = np.array(serves), np.array(costs)
    wanted = serves.any(axis=1)
    best = min(
        costs[list(places)].sum()
        for size in range(6)
        for places in combinations(range(5), size)
        if serves[:, list(places)].any(axis=1)[wanted].all()
    )
    chosen = least_cover(serves, costs)
    assert serves[:, chosen].any(axis=1)[wanted].all()
    assert costs[chosen].sum() == pytest.approx(best)


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=12), st.integers(1, 4))
@settings(max_examples=60, deadline=None)
def test_every_number_is_nearest_to_the_mean_of_its_cluster(values, count):
    values = np.array(values)
    centres = means(values, count)
    assert 1 <= len(centres) <= count
    nearest = np.abs(values[:, None] - centres).argmin(axis=1)
    for place, centre in enumerate(centres):
        assert values[nearest == place].mean() == pytest.approx(centre, abs=1e-4)


def test_trial_images_count_with_their_time(sweep):
    comparison = compare(sweep, ["each_region"])
    scores = row_of(comparison, "each_region")
    looks = scores["exposures"] + scores["trial_images"]
    assert scores["trial_images"] >= 1.0
    assert scores["exposures_over_oracle"] == pytest.approx(looks / 1.5)
    for row in comparison.frame.filter(pl.col("strategy") == "each_region").to_dicts():
        time_ms = sum(12 * t + 500 for t in row["captures_ms"])
        time_ms += sum(t + 100 for t in row["trial_images_ms"])
        assert row["time_s"] == pytest.approx(time_ms / 1000)


def test_rivals_that_scale_brightness_have_every_feature(sweep):
    comparison = compare(sweep, ["each_region", "swept_regions", "clusters_3", "adaptive"])
    assert comparison.scores["covered_share"].to_list() == [1.0] * 5
    swept = row_of(comparison, "swept_regions")
    assert swept["exposures"] == 1.5


@pytest.mark.parametrize("name", RIVALS)
def test_every_rival_measures_within_limits(name, sweep):
    limits = ExposureLimits(name="x", min_ms=1, max_ms=300, increment_ms=1, most_per_view=2)
    comparison = compare(sweep, [name], limits=limits)
    assert max(len(each.captures_ms) for each in comparison.outcomes) <= 2


def test_settings_outside_the_limits_are_nobodys():
    limits = ExposureLimits(name="x", min_ms=4, max_ms=100, increment_ms=1)
    sweep = Sweep.of(sweep_table({"v": (1.0, 0.1)}), limits=limits)
    assert sweep.views[0].settings_ms.tolist() == [4.0, 8.0, 16.0, 32.0, 64.0]
    assert sweep.pairs == 1  # the dark feature needs 200 ms


def test_constants_of_a_rehearsal_are_used_unchanged(sweep):
    dark = Sweep.of(sweep_table({"v": (0.25, 0.5)}))
    hindsight, fair = (compare(sweep, ["geometric_2"], rehearsal=each) for each in (None, dark))
    assert row_of(hindsight, "geometric_2")["covered_share"] > 0.8
    assert row_of(fair, "geometric_2")["covered_share"] < 0.8
    assert fair.about["constants"] == "chosen on sweep"


@pytest.fixture
def registered():
    """Register strategies for one test."""
    before = dict(STRATEGIES)
    yield strategy
    STRATEGIES.clear()
    STRATEGIES.update(before)


def test_a_setting_that_is_not_allowed_is_an_error(sweep, registered):
    registered("cheat", "takes what is not there")(lambda trial: trial.take(33.0))
    with pytest.raises(InputError, match=r"no exposure time of 33 ms; allowed are 2, 4, 8"):
        compare(sweep, ["cheat"])


def test_more_captures_than_limits_allow_are_an_error(sweep, registered):
    @registered("cheat", "takes all")
    def take_everything(trial: Trial) -> None:
        for exposure_ms in trial.settings_ms.tolist():
            trial.take(exposure_ms)

    limits = ExposureLimits(name="x", min_ms=1, max_ms=300, increment_ms=1, most_per_view=3)
    with pytest.raises(InputError, match="3 captures a view"):
        compare(sweep, ["cheat"], limits=limits)


def test_a_trial_image_shows_no_quality(sweep, registered):
    rows = []

    @registered("looker", "looks at brightness")
    def look(trial: Trial) -> None:
        rows.append((trial.trial(8.0), trial.take(8.0)))

    compare(sweep, ["looker"])
    image, capture = rows[0]
    assert image.frame["p_norm"].null_count() == image.frame["i_max_p50"].null_count() == 3
    assert image.frame["i_avg"].to_list() == capture.frame["i_avg"].to_list() == [8.0, 16.0, 24.0]


def test_promises_are_held_against_what_came(sweep, registered):
    @registered("promiser", "promises half")
    def promise(trial: Trial) -> None:
        trial.take(32.0)
        trial.promise(dict.fromkeys(trial.features, 0.5))
        trial.say_chances(np.full((len(trial.features), len(trial.settings_ms)), 0.5))

    scores = row_of(compare(sweep, ["promiser"]), "promiser")
    assert (scores["promised"], scores["achieved"]) == (0.5, pytest.approx(4 / 6))
    assert scores["promise_brier"] == scores["chance_brier"] == 0.25

    @registered("liar", "promises what is no chance")
    def lie(trial: Trial) -> None:
        trial.promise({"f0": 1.5})

    with pytest.raises(InputError, match=r"from 0 to 1 .* got 1.5 for 'f0'"):
        compare(sweep, ["liar"])


def test_names_are_taken_once_and_misspelt_ones_are_named():
    with pytest.raises(InputError, match="there is a strategy 'adaptive' already"):
        strategy("adaptive", "another")(lambda trial: None)
    with pytest.raises(InputError, match="did you mean 'geometric_3'"):
        strategies_named(["geometric3"])


@pytest.mark.parametrize(
    ("table", "fact"),
    [
        (sweep_table({"v": (1.0,)}, times_ms=(8.0,)), "1 view at 1 exposure time"),
        (ObservationTable.concat([sweep_table({"v": (1.0,)})] * 2), "has several at 2 ms"),
    ],
)
def test_what_is_no_sweep_is_refused(table, fact):
    with pytest.raises(ObservationError, match=fact):
        Sweep.of(table)


def test_pixel_intervals_need_what_stacks_tell():
    sweep = Sweep.of(sweep_table({"v": (1.0, 2.0)}, stack=False))
    with pytest.raises(ObservationError, match="i_max_p05"):
        compare(sweep, ["pixel_intervals"])


def test_results_of_others_are_added_where_they_are_of_the_same_sweep(sweep):
    both = compare(sweep, ["adaptive"]).with_others(compare(sweep, ["geometric_2"]))
    assert both.scores["strategy"].to_list() == ["oracle", "adaptive", "geometric_2"]
    other = Sweep.of(sweep_table({"v": (1.0,)}))
    with pytest.raises(InputError, match="not of the views"):
        both.with_others(compare(other, []))


def test_intervals_hold_the_score_and_shrink_with_views():
    few, many = (
        compare(Sweep.of(sweep_table(lights)), ["geometric_2"])
        for lights in ({f"v{i}": (1.0, 16.0 if i % 2 else 2.0) for i in range(n)} for n in (4, 40))
    )
    widths = []
    for comparison in (few, many):
        score = row_of(comparison, "geometric_2")
        low, high = (score[f"exposures_over_oracle_{end}"] for end in ("low", "high"))
        assert low <= score["exposures_over_oracle"] <= high
        widths.append(high - low)
    assert widths[1] < widths[0]


def test_costs_are_counted_as_given(sweep):
    from exposight.planning.comparing.strategies import MeasuringCosts

    costs = MeasuringCosts(capture=CaptureCosts(frames=1), trial_image=CaptureCosts(frames=1))
    assert compare(sweep, [], costs=costs).outcomes[0].time_s == pytest.approx(0.032)


def test_loops_have_what_they_promise_in_a_world_that_is_as_learnt(default_models, view, capture):
    tilts = [(600.0, w, p) for w in (-5.0, 3.0) for p in (-6.0, 8.0)]
    times_ms = np.geomspace(4.0, 200.0, 15).tolist()
    table = capture([view(f"new{i}", *tilt) for i, tilt in enumerate(tilts)], times_ms)
    sweep = Sweep.of(table)
    comparison = compare(sweep, ["open_loop"], models=[default_models])
    score = row_of(comparison, "open_loop")
    assert score["covered_share"] >= 0.97
    assert score["exposures_over_oracle"] <= 1.5
    assert score["promised"] == pytest.approx(score["achieved"], abs=0.05)
    loop = row_of(compare(sweep, ["closed_loop"], models=[default_models]), "closed_loop")
    assert loop["covered_share"] == 1.0
    assert loop["exposures_over_oracle"] <= 1.5
    twice = compare(sweep, ["open_loop"], models=[default_models] * 2)
    labels = [each for each in twice.strategies if each.startswith("open_loop")]
    assert labels == [f"open_loop ({i})" for i in (1, 2)]


def test_results_are_read_as_they_were_written(sweep, tmp_path):
    comparison = compare(sweep, ["adaptive"])
    write_comparison(comparison, tmp_path)
    again = read_comparison(tmp_path)
    assert again.outcomes == comparison.outcomes
    assert str(again) == str(comparison)
    (tmp_path / "results.json").write_text('{"format": "exposight plan"}')
    with pytest.raises(FormatError, match="exposight comparison"):
        read_comparison(tmp_path)


def test_the_closed_loop_learns_a_lamp_from_view_to_view(default_models, view, capture):
    views = [view(f"new{i}", 600.0, w, 2.0) for i, w in enumerate((-5.0, -2.0, 1.0, 4.0, 7.0))]
    times_ms = np.geomspace(4.0, 400.0, 18).round(1)
    table = capture(views, times_ms)
    longer = pl.col("exposure_ms") * 5.0
    dim = ObservationTable.from_frame(table.frame.with_columns(exposure_ms=longer))
    comparison = compare(Sweep.of(dim), ["open_loop", "closed_loop"], models=[default_models])
    assert row_of(comparison, "open_loop")["covered_share"] < 0.9
    assert row_of(comparison, "closed_loop")["covered_share"] == 1.0
    loop = [each for each in comparison.outcomes if each.strategy == "closed_loop"]
    assert len(loop[-1].captures_ms) <= len(loop[0].captures_ms)

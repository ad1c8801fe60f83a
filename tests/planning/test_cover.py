"""Plans of many views: what is promised, what is left out and why, and bad questions."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exposight.cell import Part, sensor_preset
from exposight.errors import InputError, SensorError
from exposight.geometry import RigidTransform
from exposight.planning import (
    CaptureChances,
    CaptureCosts,
    ExposureLimits,
    plan,
    plan_exposures,
    trade_off,
)
from exposight.planning.covering.visiting_order import visiting_order

LIMITS = ExposureLimits(name="whole ms", min_ms=1.0, max_ms=1000.0, increment_ms=1.0, unit="us")
COSTS = CaptureCosts(frames=12, overhead_ms=500.0, move_ms=3000.0)
FEW = settings(max_examples=25, deadline=None)


def view_of(name, windows, std=0.05, settings_ms=None, **fields):
    """A view whose features have these windows, by name."""
    at = LIMITS.settings(2.0, 700.0, 40) if settings_ms is None else settings_ms
    chances = CaptureChances.of_windows(
        list(windows.values()), at, features=list(windows), std=std, view=name
    )
    return replace(chances, **fields) if fields else chances


def views_of(seed, n=8, n_views=3, std=0.05):
    rng = np.random.default_rng(seed)
    out = []
    for v in range(n_views):
        names = [f"f{i}" for i in range(n) if rng.random() < 0.6] or ["f0"]
        middle = np.exp(rng.normal(np.log(40.0), 0.8, len(names)))
        ends = np.column_stack([middle / 1.9, middle * 1.9])
        out.append(view_of(f"v{v}", dict(zip(names, ends.tolist(), strict=True)), std))
    return out


def served(views, places, confidence):
    return {
        name
        for view, chosen in zip(views, places, strict=True)
        for name, chance in zip(view.features, view.any_of(chosen), strict=True)
        if chance >= confidence
    }


@FEW
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.3, 0.5]))
def test_fewest_captures_are_no_more_than_any_choice_of_single_ones(seed, std):
    views = views_of(seed, n=5, n_views=2, std=std)
    plan = plan_exposures(views, LIMITS, COSTS)
    planned = {each.feature for each in plan.with_status("planned")}
    by_name = {view.view: view for view in views}
    for each in plan.features:  # chances are what the plan's exposures give, recomputed here
        if each.view is not None:
            taken = [e.exposure_ms for e in plan.view(each.view).exposures]
            at = by_name[each.view]
            chance = at.any_of([at.settings_ms.tolist().index(ms) for ms in taken])
            assert each.chance == pytest.approx(chance[at.features.index(each.feature)])
        assert (each.status == "planned") == (each.chance >= 0.9 - 1e-9)
    alone = {
        name
        for view in views
        for name, chance in zip(view.features, view.chance.max(axis=1), strict=True)
        if chance >= 0.9
    }
    assert alone <= planned
    assert plan.certificate.bound <= plan.n_captures == plan.certificate.objective
    if plan.n_captures > 1 and planned == alone:
        captures = [(v, i) for v, view in enumerate(views) for i in range(len(view.settings_ms))]
        for fewer in combinations(captures, 1):  # one capture less than two must not do
            places = [tuple(i for w, i in fewer if w == v) for v in range(len(views))]
            assert not alone <= served(views, places, 0.9) or plan.n_captures == 1


@FEW
@given(st.integers(0, 2**32 - 1))
def test_a_larger_budget_never_serves_fewer(seed):
    views = views_of(seed)
    counts = []
    for budget in (1, 2, 3, 5):
        plan = plan_exposures(views, LIMITS, COSTS, budget=budget)
        assert plan.n_captures <= budget
        assert plan.certificate.bound >= len(plan.with_status("planned"))
        counts.append(plan.certificate.objective)
    assert counts == sorted(counts)
    least_s = 0.0
    for budget_ms in (3000.0, 8000.0, 20000.0):
        plan = plan_exposures(views, LIMITS, COSTS, goal="time", budget=budget_ms)
        assert plan.time_ms <= budget_ms + 1e-6
        assert len(plan.with_status("planned")) >= least_s
        least_s = len(plan.with_status("planned"))


@FEW
@given(st.integers(0, 2**32 - 1))
def test_least_time_and_fewest_captures_bound_each_other(seed):
    views = views_of(seed, std=0.001)  # windows are known: no two captures share a feature's chance
    fewest, quickest = (
        plan_exposures(views, LIMITS, COSTS, goal=goal) for goal in ("count", "time")
    )
    assert quickest.time_ms <= fewest.time_ms + 1e-6
    assert fewest.n_captures <= quickest.n_captures
    short = plan_exposures(views, LIMITS, COSTS, prefer="time")
    assert short.n_captures == fewest.n_captures
    fixed = plan_exposures(views, LIMITS, COSTS, goal="time", moves=False)
    assert fixed.time_ms <= quickest.time_ms


def test_two_captures_of_one_view_serve_what_none_serves_alone():
    windows = {"hard": (20.0, 60.0)}
    view = view_of("v", windows, std=0.5)
    assert view.chance.max() < 0.75
    plan = plan_exposures([view], LIMITS, COSTS)
    (feature,) = plan.features
    assert feature.status == "planned"
    assert plan.n_captures == 2
    assert 0.9 <= feature.chance < 1.0 - (1.0 - view.chance.max()) ** 4
    one = plan_exposures([view], replace(LIMITS, most_per_view=1), COSTS)
    assert one.n_captures == 1
    assert one.features[0].status == "best effort"
    assert one.features[0].chance == pytest.approx(view.chance.max(), rel=0.06)


def test_no_feature_is_left_off_the_list_and_each_failure_has_a_reason():
    windows = {
        "good": (20.0, 90.0),
        "dark": (3000.0, 9000.0),
        "narrow": (30.0, 30.5),
        "glare": (0.1, 0.4),
    }
    plan = plan_exposures([view_of("v", windows)], LIMITS, not_seen={"behind": "faces away"})
    status = {each.feature: (each.status, each.reason) for each in plan.features}
    assert status["good"] == ("planned", "")
    assert "too dark: needs 3000 ms or more" in status["dark"][1]
    assert "too bright" in status["glare"][1]
    assert "30–30.5 ms" in status["narrow"][1]
    assert status["behind"] == ("not planned", "not seen, faces away")
    assert all(state == "not planned" for name, (state, _) in status.items() if name != "good")
    assert plan.promise.expected_covered == pytest.approx(1.0, abs=0.01)
    assert plan.verdict.startswith("take 1 capture in 1 view: 1 of 5 features")


def test_flicker_leaves_a_short_window_nothing_and_says_so():
    mains = LIMITS.under_mains(50.0)
    at = mains.settings(2.0, 700.0, 40)
    windows = {"short": (3.1, 7.8), "long": (15.0, 70.0)}
    plan = plan_exposures([view_of("v", windows, settings_ms=at)], mains)
    reasons = {each.feature: each.reason for each in plan.features}
    assert "flicker 50 Hz" in reasons["short"]
    assert all(e.exposure_ms % 10.0 == 0.0 for v in plan.views for e in v.exposures)


def test_settings_that_the_sensor_does_not_allow_are_not_planned():
    view = view_of("v", {"a": (20.0, 60.0)}, settings_ms=[21.5, 33.3, 40.0, 51.7])
    plan = plan_exposures([view], LIMITS)
    assert [e.exposure_ms for e in plan.views[0].exposures] == [40.0]
    assert (plan.views[0].exposures[0].set_value, plan.limits.unit) == (40000.0, "us")


def test_a_view_with_exactly_two_exposures_and_the_surest_first():
    windows = {"a": (20.0, 60.0), "b": (21.0, 66.0), "c": (200.0, 600.0)}
    two = replace(LIMITS, least_per_view=2, most_per_view=2, lowest_wins=True)
    plan = plan_exposures([view_of("v", windows)], two)
    exposures = plan.views[0].exposures
    assert [each.order for each in exposures] == [1, 2]
    assert exposures[0].exposure_ms < 100.0  # two features before one
    alone = plan_exposures([view_of("v", {"a": (20.0, 60.0)})], two)
    assert alone.n_captures == 2


def test_a_forecast_that_may_not_be_relied_on_counts_only_where_there_is_no_better():
    windows = {"a": (20.0, 80.0)}
    doubtful = view_of("doubtful", windows, std=0.01, reasons=("far from what was learnt",))
    known = view_of("known", windows, std=0.1)
    plan = plan_exposures([doubtful, known], LIMITS)
    assert (plan.features[0].view, plan.features[0].reason) == ("known", "")
    alone = plan_exposures([doubtful], LIMITS)
    assert alone.features[0].reason == "far from what was learnt"


@FEW
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.15, 0.3]), st.floats(0.1, 2.0))
def test_expected_misses_are_kept_with_no_more_than_the_union_bound_takes(seed, std, wish):
    views = views_of(seed, std=std)
    n = len({name for view in views for name in view.features})
    wish = min(wish, 0.9 * n)
    made = plan_exposures(views, LIMITS, COSTS, expected_misses=wish)
    strict = plan_exposures(views, LIMITS, COSTS, confidence=1.0 - wish / n)
    assert made.n_captures <= strict.n_captures
    assert made.misses == pytest.approx(sum(1.0 - each.chance for each in made.features))
    if len(strict.with_status("planned")) == n:
        assert made.misses <= wish + 1e-9
    assert any("not kept" in note for note in made.notes) == (made.misses > wish + 1e-6)
    if made.views and made.certificate.unit == "captures":
        assert "each feature at" in made.proof
        assert "fewer captures may be enough" in made.proof


def test_expected_misses_are_had_with_fewer_captures_than_the_same_chance_for_each():
    lone = {"a": (20.0, 80.0), "b": (60.0, 190.0)}  # both at once have about 3 in 4
    windows = {f"f{i}": (5.0, 400.0) for i in range(20)} | lone
    view = view_of("v", windows, std=0.2)
    strict = plan_exposures([view], LIMITS, confidence=1.0 - 1.0 / 22)
    made = plan_exposures([view], LIMITS, expected_misses=1.0)
    assert (strict.n_captures, made.n_captures) == (2, 1)
    assert made.misses <= 1.0
    assert made.confidence < strict.confidence


def test_a_wish_that_the_budget_breaks_is_named():
    windows = {"a": (20.0, 60.0), "b": (200.0, 600.0)}
    made = plan_exposures([view_of("v", windows)], LIMITS, expected_misses=0.5, budget=1)
    assert made.notes[0].startswith("not kept: 0.5 expected misses were asked for, 1 are to be")


def test_the_plan_itself_is_a_point_of_the_trade_off():
    views = views_of(3, n=12, n_views=4, std=0.3)
    for goal, column in (("count", "captures"), ("time", "time_s")):
        made = plan_exposures(views, LIMITS, COSTS, goal=goal)
        frame = trade_off(views, LIMITS, COSTS, goal=goal, plan=made).frame
        point = (made.n_captures, len(made.with_status("planned")))
        assert point in list(frame.select("captures", "features").iter_rows())
        assert frame[column].is_sorted()
        assert (frame["features"] <= frame["bound"]).all()


def test_the_chance_of_all_is_a_lower_bound():
    promise = plan_exposures(views_of(5, std=0.15), LIMITS).promise
    assert promise.chance_of_all <= promise.chance_of_all_if_independent <= 1.0


def test_without_time_the_best_plan_and_its_gap_come():
    plan = plan_exposures(views_of(7, n=30, n_views=8), LIMITS, COSTS, time_limit_s=0.001)
    assert plan.views
    assert 0.0 <= plan.certificate.gap < 1.0
    assert plan.certificate.bound <= plan.certificate.objective


def test_views_are_visited_on_short_ways():
    poses = {
        f"v{i}": RigidTransform(translation_mm=np.array([float(x), 0.0, 600.0]))
        for i, x in enumerate((0, 900, 100, 800, 200, 700))
    }
    assert visiting_order(poses) == ["v0", "v2", "v4", "v5", "v3", "v1"]


def test_the_trade_off_rises_to_all_that_can_be_had():
    views = views_of(3, n=12, n_views=4)
    whole = plan_exposures(views, LIMITS, COSTS)
    for goal, column in (("count", "captures"), ("time", "time_s")):
        frame = trade_off(views, LIMITS, COSTS, goal=goal).frame
        assert frame[column].is_sorted()
        assert frame["features"].is_sorted()
        assert (frame["features"] <= frame["bound"] + 1e-6).all()
        assert frame["features"][-1] == len(whole.with_status("planned"))


def test_where_nothing_can_be_had_the_plan_is_empty_and_says_why():
    views = [view_of("v", {"dark": (3000.0, 9000.0)})]
    made = plan_exposures(views, LIMITS, COSTS)
    assert (made.views, made.n_captures) == ((), 0)
    assert made.verdict.startswith("take none: no capture serves any of 1 feature; dark: too dark")
    assert "too dark" in made.features[0].reason
    assert str(made)
    assert trade_off(views, LIMITS, COSTS).frame.height == 0


@pytest.mark.parametrize(
    ("question", "fact"),
    [
        ({"confidence": 1.0}, "above 0 and below 1"),
        ({"confidence": 0.0}, "above 0 and below 1"),
        ({"budget": 0}, "a whole number of captures, at least one, got 0"),
        ({"budget": 1.5}, "a whole number of captures, at least one, got 1.5"),
        ({"goal": "time", "budget": 0.0}, "0.001 ms or more, got 0 ms"),
        ({"goal": "cost"}, "'count' or 'time'"),
        ({"expected_misses": 0.0}, "above 0 and below"),
        ({"time_limit_s": 0.0}, "above 0 s"),
    ],
)
def test_a_question_without_sense_is_refused(question, fact):
    with pytest.raises(InputError, match=fact):
        plan_exposures(views_of(1), LIMITS, COSTS, **question)


def test_views_without_features_and_names_there_twice_are_refused():
    views = views_of(1)
    with pytest.raises(InputError, match="no view sees a feature"):
        plan_exposures([], LIMITS)
    with pytest.raises(InputError, match="view: the name 'v0' is there twice"):
        plan_exposures([views[0], views[0]], LIMITS)
    twice = replace(views[0], features=("f0",) * len(views[0].features))
    if len(twice.features) > 1:
        with pytest.raises(InputError, match="feature of view 'v0': the name 'f0' is there twice"):
            plan_exposures([twice], LIMITS)


def test_a_part_is_planned_from_models_and_poses(default_models, view):
    part = Part(name="plate", features=tuple(each.feature for each in view("near").features))
    views = {
        "near": RigidTransform.from_fanuc_wpr((0.0, 0.0, 560.0), 0.0, 0.0, 0.0),
        "tilted": RigidTransform.from_fanuc_wpr((0.0, 0.0, 640.0), 8.0, 4.0, 0.0),
    }
    made = plan(default_models, part, views, costs=COSTS, goal="time")
    assert {each.feature for each in made.features} == {f"f{i}" for i in range(1, 10)}
    assert made.n_captures == 1  # all holes of the plate are about as bright
    assert {each.name for each in made.models} == {"quality", "exposure"}
    behind = {"behind": RigidTransform.from_fanuc_wpr((0.0, 0.0, 600.0), 180.0, 0.0, 0.0)}
    with pytest.raises(InputError, match="no view sees a feature of 'plate'"):
        plan(default_models, part, behind)
    for wrong in ({"a": "a"}, ["a"]):
        with pytest.raises(InputError, match=r"\{name: RigidTransform\}, got \['?a|got 'a'"):
            plan(default_models, part, wrong)
    with pytest.raises(InputError, match=r"a whole number of captures, at least one, got 1\.5"):
        plan(default_models, part, views, budget=1.5)
    with pytest.raises(SensorError, match="no model for this sensor"):
        plan(default_models, part, views, sensor=sensor_preset("rc-visard-65"))

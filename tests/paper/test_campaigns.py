"""What the study measures: campaigns and their plans, in full and quickly."""

import pytest

from exposight.paper.campaigns import CAMPAIGNS, Campaign, campaign_plan, plan_size


@pytest.mark.parametrize(
    ("name", "views", "captures"),
    [
        ("inside", 48, 480),
        ("finer", 25, 600),
        ("lighting-2", 1, 5),
        ("outside", 14, 70),
        ("stereo-inside", 240, 3840),
        ("stereo-outside", 6, 96),
    ],
)
def test_full_campaigns_have_the_plans_views(name: str, views: int, captures: int) -> None:
    (campaign,) = (own for own in CAMPAIGNS if own.name == name)
    plan = campaign_plan(campaign, quick=False)
    assert plan_size(plan) == (views, captures)


@pytest.mark.parametrize("campaign", CAMPAIGNS, ids=lambda own: own.name)
@pytest.mark.parametrize("quick", [True, False])
def test_plans_observe_what_the_datasets_need(campaign: Campaign, quick: bool) -> None:
    assert set(campaign.features()) <= set(campaign_plan(campaign, quick=quick).features)


def test_a_quick_study_has_all_depths_of_the_full_one() -> None:
    (stereo,) = (own for own in CAMPAIGNS if own.name == "stereo-inside")
    quick, full = (campaign_plan(stereo, quick=quick) for quick in (True, False))
    assert [own.z_tcp_mm for own in quick.planes] == [own.z_tcp_mm for own in full.planes]

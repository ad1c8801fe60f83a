"""Views that commands find by themselves: how mesh and reach are told."""

import numpy as np
import pytest
import trimesh

from exposight.cell import Feature, Part, sensor_preset
from exposight.cli.app import UsageError
from exposight.cli.auto_views import AutoViewOptions, auto_candidate_views
from exposight.errors import ExposightError, FeatureError
from exposight.geometry import RigidTransform
from exposight.plans import MeasuringPlan, PoseList, write_plan

COMET = sensor_preset("comet-pro-ae")
DOWN = np.diag([1.0, -1.0, -1.0])
PART = Part(
    name="plate",
    features=tuple(
        Feature(
            name=f"h{i}",
            kind="hole",
            part_from_feature=RigidTransform(rotation=DOWN, translation_mm=np.array([x, 0.0, 0.0])),
            radius_mm=5.0,
        )
        for i, x in enumerate((-300.0, -100.0, 100.0, 300.0))
    ),
)


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    path = tmp_path_factory.mktemp("mesh") / "plate.stl"
    trimesh.creation.box(bounds=[(-400, -200, -2), (400, 200, 0)]).export(path)
    return path


def test_candidates_have_rings_and_poses(mesh) -> None:
    options = AutoViewOptions(mesh=mesh, candidates=6)
    candidates, notes = auto_candidate_views(PART, COMET, options)
    assert not notes
    assert set(candidates.frame["view"]) == set(candidates.poses)
    assert set(candidates.frame["feature"]) == {"h0", "h1", "h2", "h3"}
    assert all(group == "auto" for group, _ in candidates.poses.values())
    _, notes = auto_candidate_views(PART, COMET, AutoViewOptions(candidates=2))
    assert "without a mesh" in notes[0]


def test_reach_is_a_box_or_a_plans_poses(mesh, tmp_path) -> None:
    box = AutoViewOptions(mesh=mesh, reach="-50:50,-50:50,500:700", candidates=4)
    for _, pose in auto_candidate_views(PART, COMET, box)[0].poses.values():
        assert (np.abs(pose.inverse().translation_mm - (0, 0, 600)) <= (50.01, 50.01, 100.01)).all()
    above = RigidTransform(rotation=DOWN, translation_mm=np.array([0.0, 0.0, 600.0]))
    poses = PoseList.from_transforms("robot", [above], exposures_ms=[10.0])
    names = tuple(feature.name for feature in PART.features)
    plan = MeasuringPlan(name="robot", sensor=COMET, features=names, poses=(poses,))
    write_plan(tmp_path / "robot.toml", plan)
    listed = AutoViewOptions(mesh=mesh, reach=str(tmp_path / "robot.toml"))
    assert set(auto_candidate_views(PART, COMET, listed)[0].poses) == {"robot"}


@pytest.mark.parametrize("reach", ["1:2", "1:2,3:4", "a:b,1:2,3:4", "1:2:3,1:2,3:4"])
def test_a_reach_that_is_none(reach: str) -> None:
    with pytest.raises(UsageError, match="X1:X2,Y1:Y2,Z1:Z2"):
        auto_candidate_views(PART, COMET, AutoViewOptions(reach=reach))


def test_a_box_without_a_view_and_a_mesh_in_metres(mesh) -> None:
    with pytest.raises(ExposightError, match="frame and unit of the reach"):
        auto_candidate_views(PART, COMET, AutoViewOptions(reach="0:1,0:1,-900:-800"))
    with pytest.raises(FeatureError, match="mm instead of m"):
        auto_candidate_views(PART, COMET, AutoViewOptions(mesh=mesh, mesh_unit="m"))

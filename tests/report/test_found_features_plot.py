"""From where a part from CAD is seen, and what its page says first."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.geometry.drilled_plates import CELL, HOLE, plate

from exposight.cell import Feature
from exposight.geometry import RigidTransform
from exposight.report.found_features_plot import found_features_plot, viewing_direction
from exposight.report.part_page import found_sentence

UPWARD = np.diag([1.0, -1.0, -1.0])


def feature(name, x=0.0, kind="hole", **sizes):
    pose = RigidTransform(rotation=UPWARD, translation_mm=np.array([x, 0.0, 0.0]))
    return Feature(name=name, part_from_feature=pose, radius_mm=5.0, kind=kind, **sizes)


@settings(deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda n: np.linalg.norm(n) > 0.1))
def test_one_face_is_seen_leaned_from_its_normal_with_z_up(normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    away = viewing_direction(np.tile(normal, (3, 1)))
    assert np.linalg.norm(away) == pytest.approx(1.0)
    assert away @ normal > 0.75
    assert abs(away[2]) < 0.95


def test_the_side_with_most_features_is_seen():
    normals = np.array([[0.0, 0, 1]] * 2 + [[1.0, 0, 0]] * 5)
    assert viewing_direction(normals) @ [1, 0, 0] > 0.85


def test_the_whole_part_and_names_with_room_are_in_the_figure():
    mesh = plate([HOLE] * 4, corners=24)
    crowd = [feature(f"beside h3 {i}", 3 * CELL + 0.1 * i) for i in range(1, 8)]
    features = [*(feature(f"h{i}", CELL * i) for i in range(4)), *crowd]
    drawn = found_features_plot(features, mesh.vertices.astype(np.float32), mesh.faces)
    figure = json.loads(str(drawn.json).replace("\\u003c", "<"))
    (written,) = (trace["text"] for trace in figure["data"] if trace.get("mode") == "text")
    assert written[:4] == ["h0", "h1", "h2", "h3"]
    assert len(written) < len(features)
    scene = figure["layout"]["scene"]
    for axis, column in zip("xyz", mesh.vertices.T, strict=True):
        low, high = scene[f"{axis}axis"]["range"]
        assert low < column.min()
        assert column.max() < high
    assert figure["layout"]["meta"]["further"] >= 1.0
    assert len(figure["layout"]["meta"]["names"]) == len(written)


def test_what_was_found_is_said_first():
    holes = [feature("a"), feature("b")]
    slot = feature("c", kind="slot", length_mm=20.0, width_mm=10.0)
    assert found_sentence([*holes, slot]) == "2 holes and 1 slot were found."
    assert found_sentence(holes, 3).endswith("3 holes of it not in the list.")

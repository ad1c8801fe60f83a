"""``exposight part``: from a mesh of another program to a scene."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from tests.geometry.drilled_plates import BLIND, CELL, HOLE, PIN, THICK, Cell, plate

from exposight.cell import read_features, write_features
from exposight.cli import main
from exposight.geometry import RigidTransform
from exposight.geometry.meshes.triangle_meshes import read_mesh
from exposight.plans import read_plan
from exposight.twin import SimulatedCell
from exposight.twin.part import read_scene

CELLS = [HOLE, BLIND, PIN, Cell(radius=3.0), Cell(radius=4.0, straight=6.0, direction=0.5)]


@pytest.fixture(scope="module")
def stl(tmp_path_factory):
    path = tmp_path_factory.mktemp("part") / "bracket.stl"
    mesh = plate(CELLS, 48)
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    return path


@pytest.fixture
def run(capsys):
    def call(*words):
        status = main([*map(str, words), "--json"])
        return status, json.loads(capsys.readouterr().out)

    return call


@pytest.fixture
def found(stl, tmp_path, run):
    status, answer = run("part", stl, "--unit", "mm", "-o", tmp_path / "found")
    assert status == 0
    return tmp_path / "found", answer


def test_a_unit_that_no_file_tells_is_asked_for(stl, tmp_path, run):
    status, answer = run("part", stl, "-o", tmp_path / "out")
    assert status == 1
    assert answer["error"]["type"] == "AmbiguousError"
    assert "unit=inch (the part is 5.08 × 1.016 × 0.4572 m" in answer["error"]["message"]
    assert not (tmp_path / "out").exists()


def test_the_folder_is_a_scene(found):
    folder, answer = found
    assert [row["feature"] for row in answer["found"]] == [
        "hole_01", "hole_02", "hole_03", "slot_01",
    ]  # fmt: skip
    scene = read_scene(folder)
    assert [f.radius_mm for f in scene.part.features] == pytest.approx([5, 5, 3, 4], abs=1e-3)
    assert [row["depth"] for row in answer["found"]][:2] == ["through 10 mm", "blind 6 mm"]
    assert "facing" not in (folder / "scene.toml").read_text()
    assert "<html" in (folder / "part.html").read_text()[:200]
    assert read_mesh(folder / "bracket.ply").vertices[:, 0].max() == pytest.approx(4.5 * CELL)


def test_its_own_mesh_tells_its_unit(found, tmp_path, run):
    folder, _ = found
    status, answer = run("part", folder / "bracket.ply", "-o", tmp_path / "again")
    assert status == 0
    assert len(answer["found"]) == 4


def test_side_and_finish(stl, tmp_path, run):
    status, answer = run(
        "part", stl, "--unit", "mm", "--side", "-z", "--finish", "primer", "-o", tmp_path / "low"
    )
    assert status == 0
    through = [row for row in answer["found"] if row["depth"].startswith("through")]
    assert [row["z_mm"] for row in through] == pytest.approx([-THICK] * 3)
    assert read_scene(tmp_path / "low").part_with_finishes().features[0].finish == "primer"


@pytest.fixture
def listed(found, tmp_path):
    """A list with the user's names, and how it is written."""
    features = read_features(found[0] / "features.csv")
    named = [replace(f, name=f"A{n}") for n, f in enumerate(features, start=1)]

    def write(change=lambda feature: feature):
        write_features(tmp_path / "list.csv", [change(feature) for feature in named])
        return tmp_path / "list.csv"

    return write


def moved(feature, shift):
    pose = feature.part_from_feature
    place = RigidTransform(
        rotation=pose.rotation, translation_mm=pose.translation_mm + np.asarray(shift)
    )
    return replace(feature, part_from_feature=place)


def matched(run, stl, path, tmp_path, *more):
    return run("part", stl, "--unit", "mm", "--features", path, "-o", tmp_path / "named", *more)


def test_names_of_a_list_by_position(stl, listed, tmp_path, run):
    path = listed(lambda f: moved(f, [0.2, -0.1, 0.1]))
    status, answer = matched(run, stl, path, tmp_path)
    assert status == 0
    assert [row["feature"] for row in answer["found"]] == ["A1", "A2", "A3", "A4"]
    assert answer["found"][0]["x_mm"] == pytest.approx(0.0, abs=1e-3)


def test_what_the_list_lacks_is_noted(stl, listed, tmp_path, run):
    path = listed()
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-2]) + "\n")
    status, answer = matched(run, stl, path, tmp_path)
    assert status == 0
    assert any("2 holes of the part not in" in note for note in answer["notes"])
    status, answer = matched(run, stl, path, tmp_path, "--others")
    assert [row["feature"] for row in answer["found"]] == ["A1", "A2", "hole_01", "slot_01"]


@pytest.mark.parametrize(
    ("change", "kind", "fact"),
    [
        (lambda f: moved(f, [0, 15, 0]) if f.name == "A3" else f, "FeatureError", "'A3' (hole at"),
        (lambda f: moved(f, [7, 30, 2]), "FeatureError", "moved by (-7, -30, -2) mm, 4 of 4 fit"),
        (
            lambda f: replace(f, radius_mm=2 * f.radius_mm) if f.kind == "hole" else f,
            "ContradictionError",
            "size=diameter",
        ),
        (
            lambda f: replace(f, radius_mm=f.radius_mm + 1) if f.name == "A1" else f,
            "ContradictionError",
            "'A1' radius_mm 6, the part 5",
        ),
        (
            lambda f: moved(f, -f.part_from_feature.translation_mm * (1 - 1 / 25.4)),
            "FeatureError",
            "unit=inch",
        ),
    ],
)
def test_lists_that_disagree_with_the_part(stl, listed, tmp_path, run, change, kind, fact):
    status, answer = matched(run, stl, listed(change), tmp_path)
    assert status == 1
    assert answer["error"]["type"] == kind
    assert fact in answer["error"]["message"]


def test_a_part_without_holes_is_refused(tmp_path, run):
    trimesh.creation.box((10, 20, 30)).export(tmp_path / "box.stl")
    status, answer = run("part", tmp_path / "box.stl", "--unit", "mm", "-o", tmp_path / "out")
    assert status == 1
    assert "no hole" in answer["error"]["message"]


def test_normals_of_a_list_that_point_inward_are_asked_for(stl, listed, tmp_path, run):
    path = listed()
    rows = [line.split(",") for line in path.read_text().splitlines()]
    normals = [rows[0].index(name) for name in ("nx", "ny", "nz")]
    for row in rows[1:]:
        for column in normals:
            row[column] = str(-float(row[column]))
    path.write_text("\n".join(map(",".join, rows)) + "\n")
    status, answer = matched(run, stl, path, tmp_path)
    assert status == 1
    assert answer["error"]["type"] == "AmbiguousError"
    assert "normals=inward" in answer["error"]["message"]
    status, answer = matched(run, stl, path, tmp_path, "--read-as", "normals=inward")
    assert status == 0
    assert answer["found"][0]["nz"] == 1.0
    status, answer = matched(run, stl, path, tmp_path, "--read-as", "normals=outward")
    assert answer["error"]["type"] == "ContradictionError"


def test_an_open_sheet_can_be_turned(tmp_path, run):
    mesh = plate([HOLE, HOLE], open_sheet=True)
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "a.stl")
    call = ("part", tmp_path / "a.stl", "--unit", "mm", "-o", tmp_path / "out")
    assert [row["nz"] for row in run(*call)[1]["found"]] == [1.0, 1.0]
    turned = run(*call, "--sheet-normals", "inward")[1]["found"]
    assert [row["nz"] for row in turned] == [-1.0, -1.0]


def test_a_sensor_brings_a_plan_that_sees_the_features(stl, tmp_path, run):
    folder = tmp_path / "planned"
    status, _ = run(
        "part", stl, "--unit", "mm", "--sensor", "rc-visard-65", "--views", 4, "--exposures", 3,
        "-o", folder,
    )  # fmt: skip
    assert status == 0
    plan = read_plan(folder / "plan.toml")
    assert plan.n_captures == 12
    assert set(plan.features) == {"hole_01", "hole_02", "hole_03", "slot_01"}
    assert SimulatedCell.for_plan(plan, folder=folder).part.name == "bracket"

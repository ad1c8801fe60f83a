"""Captures of meshes that other programs wrote."""

import numpy as np
import pytest
import trimesh

from exposight.cell import Feature, write_features
from exposight.geometry import RigidTransform
from exposight.observing import Observer
from exposight.twin import AlignmentErrors, SimulatedCell, SimulatedCellSettings

EXACT = AlignmentErrors(photogrammetric_mm=0, photogrammetric_deg=0)


def hole(name, x_mm, y_mm=0.0):
    pose = RigidTransform(translation_mm=np.array([x_mm, y_mm, 0.0]))
    return Feature(name=name, kind="surface_point", part_from_feature=pose, radius_mm=8.0)


def bracket():
    """A plate whose face z = 0 looks along −z, and a tube that stands on it."""
    plate = trimesh.creation.box(extents=(160, 120, 4)).apply_translation((0, 0, 2))
    tube = trimesh.creation.annulus(r_min=8.0, r_max=12.0, height=20.0, sections=64)
    return trimesh.util.concatenate([plate, tube.apply_translation((0, 35, -10))])


@pytest.fixture
def look(small_sensor, before):
    def capture(scene):
        settings = SimulatedCellSettings(scene=scene, finish="primer", alignment=EXACT)
        cell = SimulatedCell(small_sensor, settings)
        return cell, cell.capture(60.0, before(), view="one")

    return capture


@pytest.fixture
def folder(tmp_path):
    write_features(tmp_path / "features.csv", [hole("left", -45.0), hole("right", 45.0)])
    return tmp_path


def test_captures_are_those_of_the_surface_in_whatever_file(folder, look):
    bracket().export(folder / "first.ply")
    cell, first = look(folder / "first.ply")
    x, y, z = first.camera_from_part.inverse().apply(first.cloud.valid_points).T
    assert len(z) > 30_000
    on_plate = np.hypot(x, y - 35) > 40
    assert np.median(np.abs(z[on_plate])) < 0.1
    on_tube = np.abs(np.hypot(x, y - 35) - 10) < 1.5
    assert np.median(z[on_tube]) == pytest.approx(-20, abs=0.1)
    for name in ("second.stl", "third.obj", "fourth.glb"):
        mesh = bracket().apply_scale(0.001 if name.endswith(".glb") else 1.0)
        mesh.export(folder / name)
        other, again = look(folder / name)
        assert (np.abs(again.image.astype(int) - first.image) > 2).mean() < 1e-3
        assert (again.cloud.valid != first.cloud.valid).mean() < 1e-3
        both = again.cloud.valid & first.cloud.valid
        assert np.median(np.abs(again.cloud.points - first.cloud.points)[both]) < 1e-3
        assert other.part.features == cell.part.features


def test_an_open_sheet_is_seen_from_both_sides(folder, look):
    square = np.array([(-80, -60, 0), (80, -60, 0), (80, 60, 0), (-80, 60, 0)])
    faces = [(0, 1, 2), (0, 3, 2)]  # one this way round, one that way
    trimesh.Trimesh(square, faces, process=False).export(folder / "sheet.stl")
    _, capture = look(folder)
    x, y, z = capture.camera_from_part.inverse().apply(capture.cloud.valid_points).T
    assert np.abs(z).max() < 1.0
    on_one = y * 160 < x * 120
    assert 0.9 < on_one.sum() / (~on_one).sum() < 1.1


def test_an_obstacle_hides_what_lies_behind_it(folder, look):
    bracket().export(folder / "part.stl")
    clamp = trimesh.creation.box(extents=(30, 30, 10)).apply_translation((-45, 0, -60))
    clamp.export(folder / "clamp.stl")
    document = 'format = "exposight scene"\nversion = 1\nmesh = "part.stl"\n'
    (folder / "free.toml").write_text(document)
    (folder / "clamped.toml").write_text(document + 'obstacles = ["clamp.stl"]\n')
    p_norm = {}
    for name in ("free", "clamped"):
        cell, capture = look(folder / f"{name}.toml")
        rows = Observer(cell.part, cell.sensor).observe(capture)
        p_norm[name] = {row.feature: row.p_norm for row in rows}
        assert len(cell.description()["scene_sha256"]) == 64
    assert p_norm["free"]["left"] > 0.9
    assert p_norm["clamped"]["left"] < 0.05
    assert p_norm["clamped"]["right"] == pytest.approx(p_norm["free"]["right"], abs=0.02)


def test_whatever_decides_the_light_decides_the_checksum(folder, small_sensor):
    bracket().export(folder / "part.ply")
    document = 'format = "exposight scene"\nversion = 1\nmesh = "part.ply"\n'
    sums = []
    for number, more in enumerate(
        ("", 'obstacles = ["part.ply"]', 'unit = "cm"', "crease_deg = 5")
    ):
        (folder / f"{number}.toml").write_text(document + more)
        settings = SimulatedCellSettings(scene=folder / f"{number}.toml")
        sums.append(SimulatedCell(small_sensor, settings).description()["scene_sha256"])
    assert len(set(sums)) == 4

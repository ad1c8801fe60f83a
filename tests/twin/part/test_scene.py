"""Scenes: what makes a mesh unfit, and the files that other programs open."""

import dataclasses

import numpy as np
import pytest
import trimesh

from exposight.cell import Feature, Part, read_features, read_sensor, sensor_preset, write_features
from exposight.errors import (
    DamagedFileError,
    FeatureError,
    FileError,
    FormatError,
    InputError,
    MissingFileError,
)
from exposight.geometry import RigidTransform
from exposight.twin.part import (
    FEATURES_FILE,
    MESH_FILE,
    SENSOR_FILE,
    Scene,
    check_scene,
    export_scene,
    read_scene,
)


def feature_at(position_mm):
    pose = RigidTransform(translation_mm=np.array(position_mm, dtype=float))
    return Feature(name="f1", kind="surface_point", part_from_feature=pose, radius_mm=30.0)


@pytest.fixture
def box():
    """A closed box of 100 mm × 80 mm × 2 mm, its faces of every finish."""
    mesh = trimesh.creation.box(extents=(100, 80, 2))
    part = Part(name="box", features=(feature_at((40, 30, -1)),))
    finish = np.arange(len(mesh.faces), dtype=np.uint8) % 4
    return Scene(vertices=mesh.vertices, faces=mesh.faces, face_finish=finish, part=part)


def test_a_closed_box_is_fine(box):
    assert check_scene(box) is box
    assert box.volume_mm3() == pytest.approx(100 * 80 * 2)


def changed(scene, **arrays):
    return dataclasses.replace(scene, **arrays)


def test_an_open_mesh_is_refused(box):
    with pytest.raises(InputError, match=r"'box': expected a watertight body, got 3 open edges"):
        check_scene(changed(box, faces=box.faces[1:], face_finish=box.face_finish[1:]))


def test_a_triangle_turned_round_is_refused(box):
    faces = box.faces.copy()
    faces[0] = faces[0, ::-1]
    with pytest.raises(InputError, match="turn all triangles outwards"):
        check_scene(changed(box, faces=faces))


def test_a_mesh_inside_out_is_refused(box):
    with pytest.raises(InputError, match="its triangles look inwards; turn all of them round"):
        check_scene(changed(box, faces=box.faces[:, ::-1]))


def test_a_mesh_with_doubled_triangles_is_refused(box):
    faces = np.concatenate([box.faces, box.faces])
    finish = np.concatenate([box.face_finish, box.face_finish])
    with pytest.raises(InputError, match="edges with more than two triangles"):
        check_scene(changed(box, faces=faces, face_finish=finish))


def test_a_triangle_without_area_is_refused(box):
    vertices = np.concatenate([box.vertices, [box.vertices[box.faces[0, 0]]]])
    a, b, c = box.faces[0]
    new = len(box.vertices)
    faces = np.concatenate([box.faces[1:], [[a, b, new], [b, c, new], [c, a, new]]])
    finish = np.zeros(len(faces), dtype=np.uint8)
    with pytest.raises(InputError, match="has no area; merge its corners"):
        check_scene(changed(box, vertices=vertices, faces=faces, face_finish=finish))


@pytest.mark.parametrize("scale", [0.001, 1000.0], ids=["metres", "micrometres"])
def test_a_feature_off_the_mesh_is_refused(box, scale):
    small = changed(box, vertices=box.vertices * scale)
    with pytest.raises(FeatureError, match=r"feature 'f1' lies .* the same frame, and are in mm"):
        check_scene(small)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"vertices": np.zeros((0, 3))}, r"vertices must have the shape \(n, 3\)"),
        ({"faces": np.zeros((4, 4))}, r"faces must have the shape \(n, 3\)"),
        ({"vertices": np.full((8, 3), np.nan)}, "every vertex must be finite"),
        ({"faces": np.full((12, 3), 8)}, "faces must number vertices from 0 to 7, got 8 to 8"),
        ({"face_finish": np.zeros(3)}, "one entry for each of 12 faces"),
        ({"face_finish": np.full(12, 4)}, "must be one of 0 bare, 1 primer, 2 paint, 3 brushed"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(box, arrays, message):
    with pytest.raises(InputError, match=message):
        changed(box, **arrays)


# -- files ---------------------------------------------------------------------------------------


@pytest.fixture
def folder(box, tmp_path):
    export_scene(tmp_path / "scene", box, sensor_preset("comet-pro-ae"))
    return tmp_path / "scene"


def test_an_exported_scene_is_read_as_it_was(box, folder):
    again = read_scene(folder, name="box")
    np.testing.assert_array_equal(again.vertices, box.vertices)
    np.testing.assert_array_equal(again.faces, box.faces)
    np.testing.assert_array_equal(again.face_finish, box.face_finish)
    assert again.part.name == "box"
    (feature,) = again.part.features
    assert feature.part_from_feature.translation_mm == pytest.approx([40, 30, -1])


def test_other_programs_read_the_exported_files(box, folder):
    mesh = trimesh.load_mesh(folder / MESH_FILE)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(box.volume_mm3())
    assert len(read_features(folder / FEATURES_FILE)) == 1
    assert read_sensor(folder / SENSOR_FILE).name == "ZEISS COMET Pro AE"


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_mesh_of_another_program_is_bare(box, folder, encoding):
    mesh = trimesh.Trimesh(box.vertices, box.faces, process=False)
    mesh.export(folder / MESH_FILE, encoding=encoding)
    assert not read_scene(folder).face_finish.any()


def test_an_open_mesh_in_a_file_is_refused(box, folder):
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(folder / MESH_FILE)
    with pytest.raises(InputError, match="expected a watertight body"):
        read_scene(folder)


def test_a_scene_without_features_is_refused(folder):
    write_features(folder / FEATURES_FILE, [])
    with pytest.raises(FeatureError, match="lists no feature"):
        read_scene(folder)


@pytest.mark.parametrize("name", [MESH_FILE, FEATURES_FILE])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(MissingFileError, match=name):
        read_scene(folder)


@pytest.mark.parametrize("length", [0, 40, 400])
def test_a_mesh_cut_off_is_refused(folder, length):
    path = folder / MESH_FILE
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(DamagedFileError, match=r"door\.ply cannot be read as a PLY mesh"):
        read_scene(folder)


def test_a_file_without_triangles_is_refused(folder):
    trimesh.PointCloud(np.eye(3)).export(folder / MESH_FILE)
    with pytest.raises(FormatError, match="holds no triangles"):
        read_scene(folder)


def test_a_folder_that_cannot_be_made_is_named(box, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FileError, match="cannot be used for a scene"):
        export_scene(tmp_path / "file" / "scene", box, sensor_preset("comet-pro-ae"))

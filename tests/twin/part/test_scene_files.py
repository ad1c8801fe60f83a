"""Scenes in files: meshes of any program, documents, and what `export_scene` writes."""

import dataclasses
import logging
import shutil

import numpy as np
import pytest
import trimesh

from exposight.cell import (
    Feature,
    Part,
    read_features,
    read_sensor,
    sensor_preset,
    write_features,
    write_sensor,
)
from exposight.errors import (
    FeatureError,
    FileError,
    FormatError,
    MissingFileError,
    VersionError,
)
from exposight.geometry import RigidTransform
from exposight.geometry.meshes.triangle_meshes import read_mesh
from exposight.twin.light import SceneTracer
from exposight.twin.part import (
    FEATURES_FILE,
    SCENE_FILE,
    SENSOR_FILE,
    SURFACES,
    ClearCoat,
    Scene,
    SecondLobe,
    Surface,
    Zone,
    export_scene,
    exported_files,
    is_scene,
    read_scene,
    scene_sensor,
)

COMET = sensor_preset("comet-pro-ae")


def feature_at(position_mm, name="f1"):
    pose = RigidTransform(translation_mm=np.array(position_mm, dtype=float))
    return Feature(name=name, kind="hole", part_from_feature=pose, radius_mm=5.0)


def bracket():
    """Two bodies, one of them curved."""
    base = trimesh.creation.box(extents=(120, 80, 4))
    tube = trimesh.creation.annulus(r_min=9.0, r_max=12.0, height=40.0, sections=48)
    return trimesh.util.concatenate([base, tube.apply_translation((25, 10, -22))])


FEATURES = (feature_at((-30, 0, -2), "left"), feature_at((0, -20, -2), "right"))


def rays():
    """Look along z at a grid of points; off the diagonals of the bracket's triangles."""
    x, y = np.meshgrid(np.linspace(-70, 70, 141) + 0.237, np.linspace(-50, 50, 101) + 0.119)
    origins = np.stack([x.ravel(), y.ravel(), np.full(x.size, -300.0)], axis=1)
    directions = np.tile((0.05, 0.1, 1.0), (x.size, 1))
    return origins.astype(np.float32), directions.astype(np.float32)


def hits(scene):
    tracer = SceneTracer(scene)
    distance, face, u, v, _ = tracer.first_hits(*rays())
    corners = tracer.corner_normals.reshape(-1, 3, 3)[np.maximum(face, 0)]
    normal = np.einsum("nij,ni->nj", corners, np.stack([1 - u - v, u, v], axis=1))
    return np.where(distance < 1e30, distance, np.nan), normal


@pytest.fixture
def folder(tmp_path):
    write_features(tmp_path / FEATURES_FILE, FEATURES)
    return tmp_path


# -- meshes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("whole", ["file", "folder"])
@pytest.mark.parametrize("name", ["Halter 7.STL", "a.b.obj", "Bügel.glb", "door-rev2.ply"])
def test_a_mesh_of_any_format_is_the_same_scene(folder, name, whole):
    path = folder / name
    mesh = bracket()
    if path.suffix == ".glb":  # metres, by its standard
        mesh.apply_scale(0.001)
    mesh.export(path, file_type=path.suffix[1:].lower())
    scene = read_scene(path if whole == "file" else folder)
    assert scene.part.name == path.stem
    assert [feature.name for feature in scene.part.features] == ["left", "right"]
    assert not scene.face_finish.any()
    np.testing.assert_allclose(np.ptp(scene.vertices, axis=0), np.ptp(bracket().vertices, axis=0))

    finish = np.zeros(len(bracket().faces), dtype=np.uint8)
    memory = Scene(
        vertices=bracket().vertices,
        faces=bracket().faces,
        face_finish=finish,
        part=Part(name="bracket", features=FEATURES),
    )
    (distance, normal), (expected, normals) = hits(scene), hits(memory)
    np.testing.assert_allclose(distance, expected, atol=1e-3)
    there = np.isfinite(expected)
    assert there.sum() > 7000
    turned = np.sign(np.einsum("ni,ni->n", normal, normals))[:, None]
    np.testing.assert_allclose((normal * turned)[there], normals[there], atol=1e-4)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_ply_file_of_another_program_is_bare(folder, encoding):
    bracket().export(folder / "any.ply", encoding=encoding)
    assert not read_scene(folder).face_finish.any()


def test_bodies_of_a_glb_stand_where_its_nodes_say(tmp_path):
    ball = trimesh.creation.icosphere(radius=0.01)
    scene = trimesh.Scene([ball])
    scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix((0.2, 0, 0)))
    (tmp_path / "two.glb").write_bytes(scene.export(file_type="glb"))
    mesh = read_mesh(tmp_path / "two.glb")
    assert len(mesh.faces) == 2 * len(ball.faces)
    assert mesh.vertices.min(axis=0) == pytest.approx([-10, -10, -10], abs=0.1)
    assert mesh.vertices.max(axis=0) == pytest.approx([210, 10, 10], abs=0.1)


def test_quadrangles_are_cut(tmp_path):
    (tmp_path / "quad.obj").write_text("v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nf 1 2 3 4\n")
    mesh = read_mesh(tmp_path / "quad.obj")
    assert mesh.faces.shape == (2, 3)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces).area == pytest.approx(81)


def test_colours_are_those_of_triangles_or_materials(tmp_path):
    box = trimesh.creation.box()
    box.visual.face_colors[:] = (30, 144, 255, 255)
    box.export(tmp_path / "faces.ply")
    assert set(map(tuple, read_mesh(tmp_path / "faces.ply").colours)) == {(30, 144, 255, 255)}
    plain = trimesh.creation.box()
    plain.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=(255, 0, 0, 255))
    )
    trimesh.Scene([plain]).export(tmp_path / "material.glb")
    assert set(map(tuple, read_mesh(tmp_path / "material.glb").colours)) == {(255, 0, 0, 255)}
    trimesh.creation.box().export(tmp_path / "none.stl")
    assert read_mesh(tmp_path / "none.stl").colours is None


def test_triangles_without_area_are_dropped_and_logged(folder, caplog):
    mesh = bracket()
    faces = np.concatenate([mesh.faces, [[0, 0, 1], [2, 2, 2]]])
    trimesh.Trimesh(mesh.vertices, faces, process=False).export(folder / "b.ply")
    with caplog.at_level(logging.WARNING, logger="exposight"):
        assert len(read_scene(folder).faces) == len(mesh.faces)
    assert "2 triangles without area are left out" in caplog.text


@pytest.mark.parametrize("name", ["x.ply", "x.glb"])
@pytest.mark.parametrize("length", [0, 40, 400])
def test_a_mesh_cut_off_is_refused(folder, name, length):
    bracket().export(folder / name)
    (folder / name).write_bytes((folder / name).read_bytes()[:length])
    with pytest.raises(FormatError, match=rf"{name} is not a readable ... mesh"):
        read_scene(folder)


def test_a_file_without_triangles_is_refused(folder):
    trimesh.PointCloud(np.eye(3)).export(folder / "cloud.ply")
    with pytest.raises(FormatError, match=r"cloud\.ply holds no triangles"):
        read_scene(folder)
    trimesh.Trimesh(np.eye(3), [[0, 0, 1]], process=False).export(folder / "cloud.ply")
    with pytest.raises(FormatError, match="no triangle that has an area"):
        read_scene(folder)


def test_a_vertex_that_is_no_number_is_refused(folder):
    mesh = trimesh.Trimesh(np.where(np.eye(3), np.nan, 1.0), [[0, 1, 2]], process=False)
    mesh.export(folder / "nan.stl")
    with pytest.raises(FormatError, match=r"nan\.stl: every vertex must be finite"):
        read_scene(folder)


def test_a_number_of_no_vertex_is_refused(folder):
    mesh = trimesh.Trimesh(np.eye(3), [[0, 1, 7]], process=False, validate=False)
    mesh.export(folder / "index.ply")
    with pytest.raises(FormatError, match="faces must number vertices from 0 to 2, got 0 to 7"):
        read_scene(folder)


# -- which files -----------------------------------------------------------------------------------

HEADER = 'format = "exposight scene"\nversion = 1\n'


def write_document(folder, text):
    (folder / SCENE_FILE).write_text(HEADER + text)
    return folder / SCENE_FILE


def test_a_document_names_parts_obstacles_and_features(folder):
    base, tube = bracket().split()
    for name, mesh in (("base.stl", base), ("tube.obj", tube)):
        mesh.export(folder / name)
    trimesh.creation.box(extents=(20, 20, 20)).export(folder / "clamp.ply")
    (folder / "lists").mkdir()
    shutil.move(folder / FEATURES_FILE, folder / "lists" / "some.csv")
    path = write_document(
        folder,
        'name = "bracket"\nmesh = ["base.stl", "tube.obj"]\nobstacles = ["clamp.ply"]\n'
        'features = "lists/some.csv"\ncrease_deg = 10\n',
    )
    for scene in (read_scene(path), read_scene(folder)):
        assert (scene.part.name, scene.crease_deg) == ("bracket", 10.0)
        assert (len(scene.part_faces), scene.n_obstacle_faces) == (len(bracket().faces), 12)
    assert scene_sensor(path) is None


def test_a_unit_is_of_all_meshes(folder):
    for name in ("m.stl", "c.glb"):
        bracket().apply_scale(1 / 25.4).export(folder / name)
    path = write_document(folder, 'mesh = "m.stl"\nobstacles = ["c.glb"]\nunit = "inch"\n')
    assert np.ptp(read_scene(path).vertices, axis=0)[:2] == pytest.approx([120, 80])


@pytest.mark.parametrize(
    ("name", "scale", "right"), [("x.stl", 0.001, "m"), ("x.glb", 1.0, "mm"), ("x.ply", 0.1, "cm")]
)
def test_a_wrong_unit_is_named(folder, name, scale, right):
    bracket().apply_translation((0, 0, 60)).apply_scale(scale).export(folder / name)
    high = [feature_at((-30, 0, 58), "left"), feature_at((0, -20, 58), "right")]
    write_features(folder / FEATURES_FILE, high)
    with pytest.raises(FeatureError, match=f'set unit = "{right}" in its scene.toml'):
        read_scene(folder)
    write_document(folder, f'mesh = "{name}"\nunit = "{right}"\n')
    assert read_scene(folder).vertices[:, 2].max() == pytest.approx(62)


def test_features_may_be_called_after_the_mesh(folder):
    bracket().export(folder / "x.stl")
    bracket().export(folder / "y.stl")
    write_features(folder / "y.csv", FEATURES[:1])
    assert len(read_scene(folder / "x.stl").part.features) == 2
    assert len(read_scene(folder / "y.stl").part.features) == 1


def test_a_sensor_belongs_to_the_scene(folder):
    bracket().export(folder / "x.stl")
    assert scene_sensor(folder) is None
    write_sensor(folder / SENSOR_FILE, COMET)
    assert scene_sensor(folder).name == scene_sensor(folder / "x.stl").name == COMET.name
    write_sensor(folder / "other.json", sensor_preset("rc-visard-65"))
    write_document(folder, 'mesh = "x.stl"\nsensor = "other.json"\n')
    assert scene_sensor(folder).name == sensor_preset("rc-visard-65").name


def test_without_features_there_is_nothing_to_measure(folder):
    bracket().export(folder / "x.stl")
    (folder / FEATURES_FILE).unlink()
    with pytest.raises(MissingFileError, match=r"no features .* expected x\.csv or features\.csv"):
        read_scene(folder)
    write_features(folder / FEATURES_FILE, [])
    with pytest.raises(FeatureError, match="lists no feature"):
        read_scene(folder)


def test_of_several_meshes_one_must_be_named(folder):
    for name in ("one.stl", "two.obj"):
        bracket().export(folder / name)
    with pytest.raises(FormatError, match=r"several meshes, one\.stl, two\.obj: name one, or say"):
        read_scene(folder)
    assert read_scene(folder / "two.obj").part.name == "two"


@pytest.mark.parametrize("name", ["", "not-there", "x.step", "x.stl"])
def test_no_scene_is_said_to_be_none(folder, name):
    if name == "x.step":
        (folder / name).touch()
    with pytest.raises(MissingFileError, match=r"no scene at .* expected a mesh"):
        read_scene(folder / name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "key 'mesh' is missing"),
        ("mesh = 3", "key 'mesh': expected a text"),
        ("mesh = []", "key 'mesh' must name"),
        ('mesh = "x.stl"\nunits = "mm"', "key 'units' is unknown"),
        ('mesh = "x.stl"\nunit = "ft"', "key 'unit': expected 'mm', 'cm', 'm' or 'inch'"),
        ("mesh = ", "not a readable scene in TOML"),
    ],
)
def test_a_document_that_is_wrong_is_refused(folder, text, message):
    with pytest.raises(FormatError, match=message):
        read_scene(write_document(folder, text))


def test_a_document_of_a_newer_version_is_refused(folder):
    (folder / SCENE_FILE).write_text('format = "exposight scene"\nversion = 2\nmesh = "x.stl"\n')
    with pytest.raises(VersionError):
        read_scene(folder)


def test_what_looks_like_a_scene(folder):
    assert not is_scene(folder)
    bracket().export(folder / "x.ply")
    assert is_scene(folder)
    assert not is_scene(folder / "x.ply")  # a cloud more often than not
    assert is_scene(write_document(folder, 'mesh = "x.ply"\n'))
    (folder / "plan.toml").write_text("exposures_ms = [1]\n")
    assert not is_scene(folder / "plan.toml")


# -- export ----------------------------------------------------------------------------------------


@pytest.fixture
def box():
    """A closed box of 100 mm × 80 mm × 2 mm, its faces of every finish."""
    mesh = trimesh.creation.box(extents=(100, 80, 2))
    part = Part(name="box 1/2", features=(feature_at((40, 30, -1)),))
    finish = np.arange(len(mesh.faces), dtype=np.uint8) % 4
    return Scene(vertices=mesh.vertices, faces=mesh.faces, face_finish=finish, part=part)


def test_an_exported_scene_is_read_as_it_was(box, tmp_path):
    export_scene(tmp_path / "scene", box, COMET)
    again = read_scene(tmp_path / "scene")
    np.testing.assert_array_equal(again.vertices, box.vertices)
    np.testing.assert_array_equal(again.faces, box.faces)
    np.testing.assert_array_equal(again.face_finish, box.face_finish)
    assert again.part.name == box.part.name
    (feature,) = again.part.features
    assert feature.part_from_feature.translation_mm == pytest.approx([40, 30, -1])
    assert scene_sensor(tmp_path / "scene").name == COMET.name
    assert {path.name for path in (tmp_path / "scene").iterdir()} == {*exported_files(box).values()}


def test_obstacles_and_the_crease_are_exported(box, tmp_path):
    scene = dataclasses.replace(box, n_obstacle_faces=2, crease_deg=12.5)
    export_scene(tmp_path, scene, COMET)
    again = read_scene(tmp_path)
    assert (again.n_obstacle_faces, again.crease_deg) == (2, 12.5)
    np.testing.assert_array_equal(again.vertices[again.faces], scene.vertices[scene.faces])
    np.testing.assert_array_equal(again.face_finish, scene.face_finish)


GLOSS = Surface(
    diffuse_albedo=0.1,
    mirror_reflectance=0.2,
    alpha_along=0.3,
    alpha_across=0.4,
    brushed_along=(0.0, 1.0, 0.0),
    second_lobe=SecondLobe(share=0.5, mirror_reflectance=0.1, alpha_along=0.1, alpha_across=0.1),
    coat=ClearCoat(alpha=0.1),
)


def test_further_surfaces_and_zones_are_exported(box, tmp_path):
    zones = (
        Zone(finish="gloss", centre_mm=(1.0, 2.0, 3.0), radius_mm=4.0),
        Zone(finish="paint", box_mm=((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))),
    )
    surfaces = {"gloss": GLOSS, "paint": GLOSS, "bare": SURFACES["bare"]}  # in an order of its own
    finish = np.arange(len(box.faces)) % 3
    scene = dataclasses.replace(box, surfaces=surfaces, face_finish=finish, zones=zones)
    export_scene(tmp_path, scene, COMET)
    again = read_scene(tmp_path)
    assert again.zones == zones
    assert {name: again.surfaces[name] for name in surfaces} == surfaces
    for other in (again, scene):
        names = [tuple(other.surfaces)[number] for number in other.face_finish]
        assert names == [("gloss", "paint", "bare")[number] for number in finish]


COLOURED = """format = "exposight scene"
version = 1
mesh = "part.ply"
obstacles = ["clamp.stl"]
finish = "gloss"
zones = [{ finish = "bare", box_mm = [[0, 0, 0], [1, 1, 1]] }]
colours = { "#1e90ff" = "paint" }

[surfaces.gloss]
diffuse_albedo = 0.1
mirror_reflectance = 0.2
alpha_along = 0.3
alpha_across = 0.3
"""


@pytest.fixture
def coloured(folder):
    mesh = trimesh.creation.box(extents=(120, 80, 4))
    mesh.visual.face_colors = [(200, 200, 200, 255)] * 8 + [(30, 144, 255, 255)] * 4
    mesh.export(folder / "part.ply")
    trimesh.creation.icosphere().apply_translation((0, 0, 99)).export(folder / "clamp.stl")
    return folder


def test_a_document_says_which_finish_is_where(coloured):
    (coloured / SCENE_FILE).write_text(COLOURED)
    scene = read_scene(coloured)
    names = np.array(tuple(scene.surfaces))[scene.face_finish]
    assert names[:12].tolist() == ["gloss"] * 8 + ["paint"] * 4
    assert set(names[12:]) == {"bare"}  # the clamp
    assert scene.surfaces["gloss"].mirror_reflectance == 0.2
    assert [zone.finish for zone in scene.zones] == ["bare"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"gloss"', '"glos"', "'glos' is not known; did you mean 'gloss'"),
        ("#1e90ff", "#1e90fe", "'#1e90fe'; did you mean '#1e90ff'"),
        ("#1e90ff", "blue", "expected a triangle's colour as '#rrggbb'"),
        ("alpha_along", "alpha", r"'surfaces\.gloss\.alpha' is unknown"),
        ("albedo = 0.1", "albedo = 0.9", "must not reflect more than comes in"),
    ],
)
def test_a_document_with_wrong_finishes_is_refused(coloured, old, new, message):
    (coloured / SCENE_FILE).write_text(COLOURED.replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_scene(coloured)


def test_other_programs_read_the_exported_files(box, tmp_path):
    export_scene(tmp_path, box, COMET)
    mesh = trimesh.load_mesh(tmp_path / "box-1-2.ply")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(100 * 80 * 2)
    assert len(read_features(tmp_path / FEATURES_FILE)) == 1
    assert read_sensor(tmp_path / SENSOR_FILE).name == "ZEISS COMET Pro AE"


def test_folders_of_earlier_versions_still_open(box, tmp_path):
    export_scene(tmp_path, box, COMET)
    (tmp_path / SCENE_FILE).unlink()
    (tmp_path / "box-1-2.ply").rename(tmp_path / "door.ply")
    again = read_scene(tmp_path)
    assert again.part.name == "door"
    np.testing.assert_array_equal(again.face_finish, box.face_finish)
    assert scene_sensor(tmp_path).name == COMET.name


def test_a_folder_that_cannot_be_made_is_named(box, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FileError, match="cannot be used for a scene"):
        export_scene(tmp_path / "file" / "scene", box, COMET)


def test_a_mesh_that_was_cut_short_is_said_to_be_damaged(tmp_path):
    whole = trimesh.creation.box(extents=(10, 10, 2)).export(file_type="stl")
    path = tmp_path / "cut.stl"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match=r"cut\.stl is not a readable STL mesh"):
        read_mesh(path)

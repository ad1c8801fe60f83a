"""The door as it is built: a closed body, the right holes, seen as the paper's Table 9 lists."""

import dataclasses
import logging
import shutil

import numpy as np
import pytest
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from exposight.cell import ActiveSensor, Capture, Cloud, ExposureRange, sensor_preset
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.observing import observe_capture, orientation_deg, point_search, view_features
from exposight.twin import SimulatedCell, SimulatedCellSettings
from exposight.twin.part import DOOR, FINISHES, door
from exposight.twin.part import car_door as door_module
from exposight.twin.part.car_door import (
    CACHE_VARIABLE,
    NEIGHBOURS,
    build_door,
    cache_folder,
    press_beside,
)

BEFORE_INSIDE = RigidTransform()
BEFORE_OUTSIDE = RigidTransform.from_fanuc_wpr((0, 0, 0), 0, 180, 0)

TRAINING = {f"f{i}" for i in range(1, 5)}
MORE_TRAINING = {f"f{i}" for i in range(5, 10)}
TEST = {f"f{i}_test" for i in range(1, 5)}
OUTSIDE = {f"f{i}_out" for i in range(1, 6)}
SLOTS, POCKETS, SPHERES, POINTS = (
    {f"{kind}_{i}" for i in (1, 2)} for kind in ("slot", "pocket", "sphere", "point")
)
OTHER_KINDS = SLOTS | POCKETS | SPHERES | POINTS

ROUND = [hole for hole in DOOR.holes if hole.length_mm is None]

NORMAL_TOLERANCE_DEG = 0.3
"""On a crown of 2.2 m a ring of 35 mm leaves its centre's plane by 0.9°, on average by nothing."""

PERFECT_TOLERANCE = 0.05
"""How far a perfect sensor's p_norm may be from 1 where neither bead nor shadow is in the way."""


@pytest.fixture(scope="module")
def scene():
    return door()


@pytest.fixture(scope="module")
def cache(tmp_path_factory, scene):
    """A cache that holds the door alone."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(door_module, "build_door", lambda: scene)
        door(folder)
    return folder


@pytest.fixture(scope="module")
def mesh(scene):
    return trimesh.Trimesh(scene.vertices, scene.faces, process=False)


def sides(scene):
    """Return for each feature what a sensor before its side sees: (feature, tcp_from_feature)."""
    for feature in scene.part.features:
        before = BEFORE_OUTSIDE if feature.name in OUTSIDE else BEFORE_INSIDE
        yield feature, before @ feature.part_from_feature


# -- a closed body -------------------------------------------------------------------------------


def test_is_watertight_and_consistently_oriented(mesh):
    assert mesh.is_watertight
    assert mesh.is_winding_consistent


def test_euler_number_counts_every_hole_the_opening_and_the_balls(mesh):
    assert mesh.body_count == 1 + len(SPHERES)
    assert mesh.euler_number == 2 - 2 * (len(DOOR.holes) + 1) + 2 * len(SPHERES)


@pytest.mark.slow
def test_is_a_sheet_of_one_thickness_looking_outwards(mesh, scene):
    upward = mesh.face_normals[:, 2]
    spheres = [scene.part.feature(name) for name in SPHERES]
    sheet = np.ones(len(upward), dtype=bool)
    for ball in spheres:
        from_ball = mesh.triangles_center - ball.part_from_feature.translation_mm
        sheet &= np.linalg.norm(from_ball, axis=1) > ball.radius_mm
    skins = [mesh.area_faces[sheet & (sign * upward > 0.3)].sum() for sign in (-1, 1)]
    balls = sum(4 / 3 * np.pi * ball.radius_mm**3 for ball in spheres)
    # walls and rounded edges are 1 % of the skins' area
    assert mesh.volume - balls == pytest.approx(DOOR.thickness_mm * np.mean(skins), rel=0.01)


def test_is_as_large_and_as_finely_cut_as_planned(mesh):
    assert mesh.extents[:2] == pytest.approx([1000, 700], abs=2)
    assert 0.8e6 < len(mesh.faces) < 1.6e6
    smooth = np.percentile(mesh.edges_unique_length, [5, 50])
    assert (smooth > 0.15).all()
    assert (smooth <= 2.1).all()


def test_has_no_degenerate_triangle(mesh):
    assert mesh.area_faces.min() > 0.01
    assert np.degrees(mesh.face_angles.min()) > 5


def test_smooth_normals_are_those_of_the_design(scene):
    corners = scene.vertices[scene.faces[7::20]].reshape(-1, 3)
    normals = scene.corner_normals()[7::20].reshape(-1, 3)
    inner = np.abs(corners[:, 2] - DOOR.height_mm(corners[:, :2])) < 1e-9
    cosine = -(normals[inner] * DOOR.normals(corners[inner, :2])).sum(axis=1)
    error_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert np.median(error_deg) < 0.02  # single precision
    assert np.percentile(error_deg, [90, 99]) == pytest.approx([1, 3], abs=1)  # bends cut at 1 mm
    assert error_deg.max() < 12


# -- features ------------------------------------------------------------------------------------


def test_has_at_least_thirty_holes_of_3_to_30_mm(scene):
    radii = [feature.radius_mm for feature in scene.part.features if feature.kind == "hole"]
    assert len(radii) >= 30
    assert (min(radii), max(radii)) == (3, 30)


@pytest.mark.parametrize(
    ("names", "w_range", "p_range"),
    [
        (TRAINING, (1, 11), (-3, 1)),
        (MORE_TRAINING, (1, 11), (-6, 1)),
        (TEST, (-1, 5), (-13, -3)),
        (OUTSIDE, (-3, 4), (-2, 0)),
    ],
    ids=["training", "more training", "test", "outside"],
)
def test_orientations_fill_the_ranges_of_table_9(scene, names, w_range, p_range):
    seen = {feature.name: orientation_deg(feature, pose) for feature, pose in sides(scene)}
    angles = np.array([seen[name] for name in names])
    for column, (low, high) in ((0, w_range), (1, p_range)):
        values = angles[:, column]
        assert low <= values.min() < low + 0.25 * (high - low)
        assert high - 0.25 * (high - low) < values.max() <= high


@pytest.fixture(scope="module")
def rings(scene):
    """Return for each round hole the triangles of its ring and their depth in its frame."""
    centres = scene.vertices[scene.faces].mean(axis=1)
    found = {}
    for feature in map(DOOR.feature, ROUND):
        from_feature = np.abs(centres[:, :2] - feature.part_from_feature.translation_mm[:2])
        near = np.flatnonzero(from_feature.max(axis=1) < feature.radius_mm + 6)
        local = feature.part_from_feature.inverse().apply(centres[near])
        region, across = feature.measured_region(), np.linalg.norm(local[:, :2], axis=1)
        on_ring = (region.inner_mm <= across) & (across <= region.outer_mm)
        on_ring &= np.abs(local[:, 2]) < 0.6
        found[feature.name] = near[on_ring], local[on_ring, 2]
    return found


@pytest.mark.slow
def test_features_look_along_the_mesh_normals(scene, mesh, rings):
    normals = mesh.face_normals
    for feature in map(DOOR.feature, ROUND):
        on_ring, depth = rings[feature.name]
        mean = normals[on_ring].mean(axis=0)
        cosine = -float(mean @ feature.part_from_feature.z_axis) / np.linalg.norm(mean)
        assert np.degrees(np.arccos(min(cosine, 1.0))) < NORMAL_TOLERANCE_DEG, feature.name
        # the ring lies on the skin that is seen, not on the one behind it
        assert abs(depth.mean()) < 0.3, feature.name


def test_walls_stand_at_the_radius_and_rims_are_rounded(scene):
    for hole, feature in zip(ROUND, map(DOOR.feature, ROUND), strict=True):
        from_feature = np.abs(scene.vertices - feature.part_from_feature.translation_mm)
        near = from_feature.max(axis=1) < feature.radius_mm + 3
        x, y, depth = feature.part_from_feature.inverse().apply(scene.vertices[near]).T
        radius = np.hypot(x, y)
        assert radius.min() == pytest.approx(feature.radius_mm, abs=0.02), feature.name
        if hole.orientation_deg is not None:  # without a pad the skin leaves the hole's plane
            on_skin = radius[np.abs(depth) < 1e-6].min()
            assert on_skin == pytest.approx(feature.radius_mm + DOOR.rim_mm, abs=1e-6)


def test_rings_lie_on_sheet_free_of_beads_pockets_and_borders():
    for hole in DOOR.holes:
        flat = hole.radius_mm + hole.straight_mm / 2 + 10
        around = hole.centre_mm[None]
        assert DOOR.outline.distance_mm(around)[0] < -flat, hole.name
        assert DOOR.opening.distance_mm(around)[0] > flat, hole.name
        for press in DOOR.presses:
            distance = float(press.distance_mm(around)[0])
            on_floor = distance < 0 and distance < -flat
            assert on_floor or distance > press.profile.width_mm + flat, (hole.name, press)
        for other in DOOR.holes:
            if other is not hole:
                apart = float(np.linalg.norm(other.centre_mm - hole.centre_mm))
                assert apart > flat + other.radius_mm + 5, (hole.name, other.name)


def test_other_kinds_lie_on_plain_sheet_away_from_holes_and_presses(scene):
    for feature in map(scene.part.feature, sorted(OTHER_KINDS)):
        region, centre = feature.measured_region(), feature.part_from_feature.translation_mm[:2]
        xy = feature.part_from_feature.apply(region.outline(0.0))[:, :2]
        depth = feature.part_from_feature.inverse().apply(DOOR.points(xy))[:, 2]
        if feature.kind == "sphere":  # it stands on the sheet, let in by half the thickness
            depth -= feature.radius_mm - DOOR.thickness_mm / 2
        assert depth == pytest.approx(0, abs=0.5), feature.name
        assert DOOR.outline.distance_mm(xy).max() < -20
        assert DOOR.opening.distance_mm(xy).min() > 20
        for press in (*DOOR.presses, *DOOR.neighbours):
            if feature.kind != "pocket" or press.distance_mm(centre[None])[0] > 0:
                assert press.distance_mm(xy).min() > press.profile.width_mm + 3, feature.name
        for hole in DOOR.holes:
            if hole.name != feature.name:
                assert hole.distance_mm(xy).min() > 15, (feature.name, hole.name)


def test_balls_are_round_and_the_floor_of_a_pocket_is_as_deep_as_it_says(scene):
    for feature in map(scene.part.feature, SPHERES | POCKETS):
        local = feature.part_from_feature.inverse().apply(scene.vertices)
        if feature.kind == "sphere":
            distance = np.linalg.norm(local, axis=1)
            on_ball = distance < feature.radius_mm + 1e-6
            assert on_ball.sum() >= 2562, feature.name
            assert distance[on_ball & (local[:, 2] < 0)] == pytest.approx(feature.radius_mm)
        else:
            depth = {"pocket_1": 6.0, "pocket_2": 8.0}[feature.name]
            middle = np.linalg.norm(local[:, :2], axis=1) < 5
            skins = depth, depth + DOOR.thickness_mm
            off = np.abs(local[middle, 2, None] - np.array(skins)).min(axis=1)
            assert off.max() < 0.15, feature.name  # it is pressed along z, not along the normal


# -- neighbours ----------------------------------------------------------------------------------


def footprint(press):
    """Return points (n, 2) of a press, 1 mm apart."""
    reach = press.profile.width_mm
    low, high = press.bounds_mm() + np.array([[-reach], [reach]])
    xy = np.stack(np.meshgrid(*map(np.arange, low, high)), axis=-1).reshape(-1, 2)
    return xy[press.distance_mm(xy) < reach]


def collides(press, others):
    xy = footprint(press)
    if DOOR.outline.distance_mm(xy).max() > -5 or DOOR.opening.distance_mm(xy).min() < 5:
        return True
    for hole in DOOR.holes:  # all rings end 5 mm beyond their holes
        if np.linalg.norm(xy - hole.centre_mm, axis=1).min() < hole.radius_mm + 5 + 2.99:
            return True
    distances = [(other, other.distance_mm(xy)) for other in others]
    return not all(d.max() < -2 or d.min() > other.profile.width_mm + 2 for other, d in distances)


def drawn_neighbours():
    """Draw half of the study's inside holes and half of the others, and what lies beside them."""
    rng = np.random.default_rng(1)
    inside = [hole for hole in ROUND if hole.side == "inside"]
    drawn, presses = {}, list(DOOR.presses)
    for of_study in (True, False):
        group = [hole for hole in inside if (hole.orientation_deg is not None) == of_study]
        wanted = len(drawn) + len(group) // 2
        for index in rng.permutation(len(group)):
            for _ in range(20 if len(drawn) < wanted else 0):
                kind = ("bead", "platform", "recess")[rng.integers(3)]
                how = kind, round(rng.uniform(0, 360)), round(rng.uniform(3, 6), 1)
                press = press_beside(group[index], *how)
                if not collides(press, presses):
                    drawn[group[index].name] = how
                    presses.append(press)
                    break
    return drawn


def test_half_of_the_inside_holes_have_the_neighbours_that_were_drawn():
    assert len(NEIGHBOURS) == 14
    assert len(NEIGHBOURS.keys() & (TRAINING | MORE_TRAINING | TEST)) == 6
    assert drawn_neighbours() == NEIGHBOURS


def test_neighbours_begin_3_to_6_mm_beyond_the_ring():
    beside = [hole for hole in DOOR.holes if hole.name in NEIGHBOURS]
    for hole, press in zip(beside, DOOR.neighbours, strict=True):
        foot = press.distance_mm(hole.centre_mm[None])[0] - press.profile.width_mm
        assert 3 <= foot - (hole.radius_mm + 5) + 1e-9 <= 6 + 2e-9, hole.name


def test_no_neighbour_reaches_a_ring_and_rings_on_pads_are_flat():
    alone = dataclasses.replace(DOOR, neighbours=())
    distance, angle = np.meshgrid(np.linspace(0, 5, 11), np.linspace(0, 2 * np.pi, 181))
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for hole in DOOR.holes:
        xy = hole.centre_mm + ((hole.radius_mm + distance)[..., None] * around).reshape(-1, 2)
        np.testing.assert_array_equal(DOOR.height_mm(xy), alone.height_mm(xy))
        if hole.orientation_deg is not None:
            depth = DOOR.frame(hole.centre_mm).inverse().apply(DOOR.points(xy))[:, 2]
            assert depth == pytest.approx(0, abs=1e-6), hole.name


@pytest.mark.slow
def test_inside_is_bare_and_each_outside_group_has_its_finish(scene, rings):
    found = {}
    for name, (on_ring, _) in rings.items():
        (finish,) = np.unique(scene.face_finish[on_ring])
        found[name] = FINISHES[finish]
    groups = [{found[f"f{i}_out"] for i in group} for group in ((1,), (2, 3), (4, 5))]
    assert groups == [{"primer"}, {"paint"}, {"brushed"}]
    assert {found[name] for name in found if name not in OUTSIDE} == {"bare"}


# -- seen by a perfect sensor --------------------------------------------------------------------


@pytest.fixture(scope="module")
def embree(scene):
    tracer = EmbreeScene()
    meshes = TriangleMesh(tracer, scene.vertices.astype(np.float32), scene.faces)
    return tracer, meshes


@pytest.fixture(scope="module")
def sensor():
    """The structured-light sensor with every second pixel."""
    full = sensor_preset("comet-pro-ae")
    camera = PinholeCamera(
        width=full.camera.width // 2,
        height=full.camera.height // 2,
        fx=full.camera.fx / 2,
        fy=full.camera.fy / 2,
        cx=(full.camera.cx - 0.5) / 2,
        cy=(full.camera.cy - 0.5) / 2,
    )
    return ActiveSensor(
        name="half",
        cameras=(camera,),
        first_from_camera=full.first_from_camera,
        projector=full.projector,
        camera_from_tcp=full.camera_from_tcp,
        exposure=ExposureRange(min_ms=1, max_ms=1000, increment_ms=1),
        working_distance_mm=full.working_distance_mm,
    )


def trace(embree, origins, directions):
    """Return distances in units of the directions, NaN where nothing is hit."""
    hits = embree[0].run(
        np.ascontiguousarray(origins, dtype=np.float32),
        np.ascontiguousarray(directions, dtype=np.float32),
        output=1,
    )
    return np.where(hits["primID"] >= 0, hits["tfar"], np.nan)


def perfect_cloud(embree, sensor, camera_from_part):
    """One exact point for every pixel that sees the door."""
    rays = sensor.camera.rays().reshape(-1, 2)
    rays = np.column_stack([rays, np.ones(len(rays))])
    part_from_camera = camera_from_part.inverse()
    origins = np.broadcast_to(part_from_camera.translation_mm, rays.shape)
    depth = trace(embree, origins, rays @ part_from_camera.rotation.T)
    points = (rays * depth[:, None]).reshape(sensor.camera.height, sensor.camera.width, 3)
    return Cloud(points=points.astype(np.float32))


def perfect_rows(scene, embree, sensor, camera_from_part):
    cloud = perfect_cloud(embree, sensor, camera_from_part)
    image = np.full((sensor.camera.height, sensor.camera.width), 100, dtype=np.uint8)
    capture = Capture(
        view="v",
        exposure_ms=10.0,
        image=image,
        cloud=cloud,
        camera_from_part=camera_from_part,
    )
    views = view_features(scene.part, sensor, camera_from_part)
    rows = observe_capture(capture, views, point_search(cloud, sensor.camera))
    return {row.feature: row.p_norm for row in rows if row.p_norm is not None}


@pytest.mark.parametrize(
    ("before", "position_mm", "names"),
    [
        (BEFORE_INSIDE, (0, 0, 0), TRAINING | TEST | OTHER_KINDS),
        (BEFORE_INSIDE, (-150, 80, -190), {"f1", "f2"}),
        (BEFORE_INSIDE, (100, -60, -190), {"f1", "f1_test"}),
        (BEFORE_INSIDE, (0, 0, 200), TRAINING | MORE_TRAINING | TEST),
        (BEFORE_OUTSIDE, (150, -250, 60), OUTSIDE - {"f1_out"}),
        (BEFORE_OUTSIDE, (40, -230, 0), {"f1_out", "f2_out", "f3_out"}),
    ],
)
def test_a_perfect_sensor_finds_every_point(scene, embree, sensor, before, position_mm, names):
    moved = RigidTransform(translation_mm=position_mm) @ before
    rows = perfect_rows(scene, embree, sensor, sensor.camera_from_tcp @ moved)
    assert names <= rows.keys()
    for name, p_norm in rows.items():
        assert p_norm == pytest.approx(1.0, abs=PERFECT_TOLERANCE), name


def test_every_kind_is_measured_in_one_view():
    """At an exposure time that suits primer before the middle of the door."""
    sensor = sensor_preset("comet-pro-ae")
    settings = SimulatedCellSettings(rings_only=True, finish="primer")
    cell = SimulatedCell(sensor, settings, features=OTHER_KINDS | {"f1"})
    capture = cell.capture(120.0, sensor.camera_from_tcp, view="v")
    views = view_features(cell.part, sensor, capture.camera_from_part)
    rows = observe_capture(capture, views, point_search(capture.cloud, sensor.camera))
    p_norm = {row.feature: row.p_norm for row in rows}
    kinds = {cell.part.feature(name).kind for name in OTHER_KINDS | {"f1"}}
    assert kinds == {"hole", "slot", "pocket", "sphere", "surface_point"}
    assert min(p_norm[name] for name in OTHER_KINDS | {"f1"}) >= 0.9


def test_pockets_and_beads_throw_shadows(scene, embree, sensor):
    camera_from_part = sensor.camera_from_tcp @ RigidTransform(translation_mm=(200, -100, -100))
    cloud = perfect_cloud(embree, sensor, camera_from_part)
    part_from_camera = camera_from_part.inverse()
    points = part_from_camera.apply(cloud.valid_points[::7])
    lamp = part_from_camera.apply(sensor.projector.camera_from_projector.translation_mm)
    towards = (lamp - points) / np.linalg.norm(lamp - points, axis=1, keepdims=True)
    shaded = ~np.isnan(trace(embree, points + 0.05 * towards, towards))
    assert 0.002 < shaded.mean() < 0.1


# -- cache ---------------------------------------------------------------------------------------


@pytest.fixture
def no_building(monkeypatch):
    def refuse(*_):
        pytest.fail("the door was built, though it is in the cache")

    monkeypatch.setattr(door_module, "build_door", refuse)


@pytest.fixture
def rebuilt(monkeypatch, scene):
    """Count how often the door is built, without doing it."""
    calls = []

    def build():
        calls.append(1)
        return scene

    monkeypatch.setattr(door_module, "build_door", build)
    return calls


@pytest.mark.slow
def test_the_door_on_disk_is_what_is_built(scene):
    built = build_door()
    np.testing.assert_array_equal(built.vertices, scene.vertices)
    np.testing.assert_array_equal(built.faces, scene.faces)
    np.testing.assert_array_equal(built.face_finish, scene.face_finish)


@pytest.mark.usefixtures("no_building")
def test_a_cached_door_is_read(cache, scene):
    cached = door(cache)
    np.testing.assert_array_equal(cached.vertices, scene.vertices)
    np.testing.assert_array_equal(cached.faces, scene.faces)
    np.testing.assert_array_equal(cached.face_finish, scene.face_finish)
    assert [f.name for f in cached.part.features] == [f.name for f in scene.part.features]


def flip(data):
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


@pytest.mark.parametrize(
    "damage",
    [flip, lambda data: data[: len(data) // 2], lambda _: b"", lambda _: b"not an archive"],
    ids=["flipped bit", "cut off", "empty", "another file"],
)
def test_a_damaged_cache_is_built_again(cache, tmp_path, rebuilt, caplog, damage):
    shutil.copytree(cache, tmp_path, dirs_exist_ok=True)
    (damaged,) = tmp_path.glob("*.npz")
    damaged.write_bytes(damage(damaged.read_bytes()))
    with caplog.at_level(logging.WARNING):
        door(tmp_path)
    assert len(rebuilt) == 1
    assert "made again" in caplog.text
    door(tmp_path)
    assert len(rebuilt) == 1


def test_a_cache_of_other_content_is_built_again(cache, tmp_path, rebuilt, caplog):
    shutil.copytree(cache, tmp_path, dirs_exist_ok=True)
    (other,) = tmp_path.glob("*.npz")
    with np.load(other) as archive:
        arrays = dict(archive)
    arrays["vertices"][0] += 1.0
    np.savez(other, **arrays)
    door(tmp_path)
    assert len(rebuilt) == 1
    assert "made again" in caplog.text


def test_a_cache_that_cannot_be_written_costs_only_time(tmp_path, rebuilt, caplog):
    no_folder = tmp_path / "file"
    no_folder.write_text("in the way")
    assert door(no_folder).part.name == "door"
    assert len(rebuilt) == 1
    assert "could not be cached" in caplog.text


def test_another_design_has_another_cache(cache, tmp_path, rebuilt, monkeypatch):
    shutil.copytree(cache, tmp_path, dirs_exist_ok=True)
    monkeypatch.setattr(door_module, "_VERSION", 999)
    door(tmp_path)
    assert len(rebuilt) == 1


def test_the_cache_folder_can_be_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert cache_folder() == tmp_path


@pytest.mark.parametrize(
    ("platform", "variable"),
    [("linux", "XDG_CACHE_HOME"), ("win32", "LOCALAPPDATA"), ("darwin", "HOME")],
)
def test_the_cache_is_where_the_platform_keeps_caches(monkeypatch, tmp_path, platform, variable):
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setattr("sys.platform", platform)
    monkeypatch.setenv(variable, str(tmp_path))
    assert cache_folder().is_relative_to(tmp_path)
    assert "exposight" in cache_folder().parts

"""Normals for shading: flat faces stay flat however they are cut, curved ones are smooth."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from exposight.twin.part.corner_normals import CREASE_DEG, corner_normals

HOLES = ((-30.0, 5.0, 12.0), (25.0, -10.0, 6.0))
HALF_MM = np.array([80.0, 50.0])


def filleted_plate(sections, fillet_steps=0, lattice_mm=None, fillet_mm=1.0):
    """Cut an open plate that faces −z, with holes: fillets down to their walls, or bare edges.

    Without a lattice only borders have vertices, as in meshes that CAD kernels make.
    """
    corners = HALF_MM * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    turn = np.arange(sections) * 2 * np.pi / sections
    round_ = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    reach = fillet_mm if fillet_steps else 0.0
    rings = [np.array([x, y]) + (r + reach) * round_ for x, y, r in HOLES]
    points = np.concatenate([corners, *rings])
    if lattice_mm:
        x, y = (np.arange(-half, half + 1e-9, lattice_mm) for half in HALF_MM)
        inner = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        for x, y, r in HOLES:
            inner = inner[np.hypot(*(inner - (x, y)).T) > r + reach + 0.2 * lattice_mm]
        points = np.concatenate([points, inner])
    faces = Delaunay(points).simplices
    for x, y, r in HOLES:
        faces = faces[np.hypot(*(points[faces].mean(axis=1) - (x, y)).T) > (r + reach) * 0.98]
    vertices = [np.column_stack([points, np.zeros(len(points))])]
    faces, n_flat = [faces[:, ::-1]], len(faces)
    count = len(points)
    for hole, (x, y, r) in enumerate(HOLES):
        above = 4 + hole * sections + np.arange(sections)
        for step in range(1, fillet_steps + 2):
            bend = step * np.pi / 2 / max(fillet_steps, 1)
            radius, depth = r + fillet_mm * (1 - np.sin(bend)), fillet_mm * (1 - np.cos(bend))
            if step == fillet_steps + 1:
                radius, depth = r, 3.0
            vertices.append(np.column_stack([(x, y) + radius * round_, np.full(sections, depth)]))
            below = count + np.arange(sections)
            count += sections
            ahead, under = np.roll(above, -1), np.roll(below, -1)
            faces.append(np.stack([above, below, under], axis=1))
            faces.append(np.stack([above, under, ahead], axis=1))
            above = below
    return np.concatenate(vertices), np.concatenate(faces).astype(np.int32), n_flat


def angles_deg(normals, others):
    cosine = np.einsum("...i,...i->...", normals.astype(float), others)
    sine = np.linalg.norm(np.cross(normals.astype(float), others), axis=-1)
    return np.degrees(np.arctan2(sine, cosine))


@pytest.mark.parametrize("fillet_steps", [0, 4, 6], ids=["edges", "4 steps", "6 steps"])
@pytest.mark.parametrize("sections", [13, 40, 300])
@pytest.mark.parametrize("lattice_mm", [None, 3.0, 0.9], ids=["borders only", "coarse", "fine"])
def test_a_flat_face_with_holes_stays_flat(sections, fillet_steps, lattice_mm):
    vertices, faces, n_flat = filleted_plate(sections, fillet_steps, lattice_mm)
    normals = corner_normals(vertices, faces)
    assert angles_deg(normals[:n_flat], np.array([0.0, 0.0, -1.0])).max() < 0.1


def test_a_fillet_beside_a_flat_face_is_smooth():
    vertices, faces, n_flat = filleted_plate(sections=120, fillet_steps=6)
    normals, corners = corner_normals(vertices, faces), vertices[faces]
    for x, y, r in HOLES:
        apart = corners[..., :2] - (x, y)
        radius = np.hypot(*np.moveaxis(apart, -1, 0))
        on_fillet = (corners[..., 2] < 1.001).all(axis=1) & (radius < r + 1.001).all(axis=1)
        on_fillet[:n_flat] = False
        # its axis is a circle of radius r + 1 at the depth of 1 mm
        foot = np.concatenate([apart / radius[..., None] * (r + 1), np.ones((*radius.shape, 1))], 2)
        true = np.concatenate([apart, corners[..., 2:]], axis=2) - foot
        assert on_fillet.sum() == 2 * 120 * 6
        assert angles_deg(normals[on_fillet], true[on_fillet]).max() < 2.0  # of steps of 15°


@pytest.mark.parametrize(
    ("ball", "most_deg"),
    [
        (trimesh.creation.icosphere(subdivisions=4, radius=20.0), 0.5),
        (trimesh.creation.uv_sphere(radius=20.0, count=[48, 48]), 1.0),
        (trimesh.creation.uv_sphere(radius=20.0, count=[14, 14]), 6.0),
    ],
    ids=["ico", "fine", "coarse"],
)
def test_a_ball_is_smooth(ball, most_deg):
    normals = corner_normals(ball.vertices, ball.faces.astype(np.int32))
    there = np.linalg.norm(normals, axis=2) > 0
    assert angles_deg(normals, ball.vertices[ball.faces])[there].max() < most_deg


def test_the_edges_of_a_box_are_sharp():
    box = trimesh.creation.box(extents=(100, 80, 2))
    normals = corner_normals(box.vertices, box.faces.astype(np.int32))
    np.testing.assert_allclose(normals, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-7)


@pytest.mark.parametrize(("steps_deg", "smooth"), [(28.6, True), (30.0, False)])
def test_the_crease_lies_between_curved_faces_and_chamfers(steps_deg, smooth):
    turn = np.radians([0.0, steps_deg])
    strip = np.array([(1.0, 0.0), (0.0, 0.0), (-np.cos(turn[1]), np.sin(turn[1]))])
    vertices = np.concatenate([np.insert(strip, 1, y, axis=1) for y in (0.0, 1.0)])
    faces = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)], dtype=np.int32)
    normals = corner_normals(vertices, faces)
    tilt = angles_deg(normals[0, 1], normals[0, 0].astype(float))
    assert tilt == pytest.approx(steps_deg / 2 if smooth else 0.0, abs=0.05)
    assert angles_deg(corner_normals(vertices, faces, steps_deg + 1)[0, 1], normals[0, 0]) > 10
    assert 28.6 < CREASE_DEG < 30


@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0, 0.3))
def test_vertices_at_one_place_are_one(seed, share):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=20.0)
    faces = ball.faces.astype(np.int32)
    apart = ball.vertices[faces].reshape(-1, 3)
    # 10⁻⁶ of the diagonal is 0.07 µm
    apart += share * 7e-5 * np.random.default_rng(seed).uniform(-1, 1, apart.shape) / np.sqrt(3)
    alone = np.arange(len(apart), dtype=np.int32).reshape(-1, 3)
    np.testing.assert_allclose(
        corner_normals(apart, alone), corner_normals(ball.vertices, faces), atol=2e-4
    )


@given(seed=st.integers(0, 2**32 - 1))
def test_orientation_decides_the_side_alone(seed):
    ball = trimesh.creation.uv_sphere(radius=20.0, count=[12, 12])
    faces = ball.faces.astype(np.int32)
    turned = np.random.default_rng(seed).random(len(faces)) < 0.5
    mixed = faces.copy()
    mixed[turned] = mixed[turned, ::-1]
    expected = corner_normals(ball.vertices, faces)
    expected[turned] = -expected[turned, ::-1]
    np.testing.assert_allclose(corner_normals(ball.vertices, mixed), expected, atol=1e-6)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-3, 1e3))
def test_place_pose_and_unit_do_not_matter(seed, scale):
    generator = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=generator).as_matrix()
    vertices, faces, _ = filleted_plate(sections=24, fillet_steps=4)
    moved = scale * (vertices @ rotation.T + generator.uniform(-500, 500, 3))
    np.testing.assert_allclose(
        corner_normals(moved, faces), corner_normals(vertices, faces) @ rotation.T, atol=1e-5
    )


def test_a_triangle_without_area_has_no_influence():
    box = trimesh.creation.box(extents=(100, 80, 2))
    faces = box.faces.astype(np.int32)
    more = np.concatenate([faces, [[0, 1, 1], [2, 2, 2]]]).astype(np.int32)
    normals = corner_normals(box.vertices, more)
    np.testing.assert_array_equal(normals[:-2], corner_normals(box.vertices, faces))
    assert not normals[-2:].any()

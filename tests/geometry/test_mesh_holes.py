"""Holes found in meshes: closed forms, laws under motion, faults of meshes."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.geometry.drilled_plates import BLIND, CELL, HOLE, PIN, THICK, Cell, plate

from exposight.errors import FormatError
from exposight.geometry.meshes.mesh_holes import find_holes
from exposight.geometry.meshes.mesh_mending import mend_mesh
from exposight.geometry.meshes.rim_shapes import fit_rim
from exposight.geometry.meshes.triangle_meshes import Mesh

EXACT = 1e-5  # mm: vertices are welded on a grid of 1e-7 of the part


def found(mesh, **options):
    return find_holes(mend_mesh(mesh), **options).openings


def upper(openings):
    return sorted((o for o in openings if o.normal[2] > 0.9), key=lambda o: o.centre_mm[0])


def test_through_blind_and_pin():
    openings = found(plate([HOLE, BLIND, PIN, Cell(radius=3.0)]))
    assert len(openings) == 5  # two sides, one, none, two
    through, blind, small = upper(openings)
    assert (through.depth, blind.depth) == ("through", "blind")
    assert through.depth_mm == pytest.approx(THICK)
    assert blind.depth_mm == pytest.approx(6.0)
    assert blind.centre_mm == pytest.approx([CELL, 0, 0], abs=EXACT)
    assert [o.radius_mm for o in (through, blind, small)] == pytest.approx([5, 5, 3], abs=EXACT)


@pytest.mark.parametrize("corners", [16, 32, 160])
def test_radius_does_not_depend_on_the_tessellation(corners):
    assert upper(found(plate([HOLE], corners)))[0].radius_mm == pytest.approx(5.0, abs=EXACT)


def test_corners_in_the_middle_of_chords_do_not_shrink_a_circle():
    soup = mend_mesh(plate([HOLE, Cell(radius=4, straight=6, direction=0.3)], 24)).mesh
    vertices, faces = trimesh.remesh.subdivide(soup.vertices, soup.faces)
    vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    hole, slot = upper(found(Mesh(vertices=vertices, faces=faces.astype(np.int32))))
    assert hole.radius_mm == pytest.approx(5.0, abs=EXACT)
    assert (slot.length_mm, slot.width_mm) == pytest.approx((20.0, 8.0), abs=1e-3)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    radii=st.lists(st.floats(1.5, 15.0), min_size=1, max_size=4),
    corners=st.sampled_from([16, 24, 40]),
    sheet=st.booleans(),
)
def test_motion_order_and_unit_change_nothing(seed, radii, corners, sheet):
    rng = np.random.default_rng(seed)
    mesh = plate([Cell(radius=r) for r in radii], corners, open_sheet=sheet)
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-500, 500, 3)
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    faces = np.roll(faces, int(rng.integers(3)), axis=1)
    openings = found(Mesh(vertices=mesh.vertices @ turn.T + shift, faces=faces), radius_mm=(1, 20))
    places = np.array([[i * CELL, 0.0, 0.0] for i in range(len(radii))]) @ turn.T + shift
    assert len(openings) == len(radii) * (1 if sheet else 2)
    for place, radius in zip(places, radii, strict=True):
        nearest = min(openings, key=lambda o: np.linalg.norm(o.centre_mm - place))
        assert nearest.centre_mm == pytest.approx(place, abs=1e-3)
        assert nearest.radius_mm == pytest.approx(radius, abs=1e-3)
        assert nearest.normal @ turn[:, 2] == pytest.approx(1.0, abs=1e-6)
        assert nearest.depth == ("sheet" if sheet else "through")


@settings(deadline=None, max_examples=20)
@given(
    angle=st.floats(0.0, math.pi),
    straight=st.floats(2.0, 10.0),
    radius=st.floats(2.0, 5.0),
    sheet=st.booleans(),
)
def test_slots_at_any_angle(angle, straight, radius, sheet):
    slot = Cell(radius=radius, straight=straight, direction=angle)
    (opening,) = upper(found(plate([slot], 96, open_sheet=sheet)))
    assert opening.outline == "slot"
    assert opening.centre_mm == pytest.approx([0, 0, 0], abs=1e-3)
    assert (opening.length_mm, opening.width_mm) == pytest.approx(
        (2 * (straight + radius), 2 * radius), abs=1e-3
    )
    along = abs(opening.direction @ [math.cos(angle), math.sin(angle), 0.0])
    assert along == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(
    ("profile", "radius", "edge"),
    [
        (((0.5, 0), (0, -0.5), (0, -THICK)), 5.0, "edge broken 0.5 mm"),
        (((3, 0), (0, -3), (0, -THICK)), 8.0, "countersunk from 5 mm"),
        (((4, 0), (4, -4), (0, -4), (0, -THICK)), 9.0, "counterbored"),
    ],
)
def test_edges_of_holes(profile, radius, edge):
    openings = found(plate([Cell(profile=profile), PIN], 48))
    (opening,) = upper(openings)
    assert (opening.radius_mm, opening.edge) == (pytest.approx(radius, abs=1e-3), edge)
    assert opening.centre_mm == pytest.approx([0, 0, 0], abs=1e-3)
    lower = next(o for o in openings if o.normal[2] < 0)
    assert lower.radius_mm == pytest.approx(5.0, abs=1e-3)
    assert opening.depth == lower.depth == "through"


def test_a_rounded_rim_keeps_the_walls_radius():
    steps = np.linspace(0, math.pi / 2, 7)
    arc = [(0.6 - 0.6 * math.sin(a), -0.6 + 0.6 * math.cos(a)) for a in steps]
    (opening,) = upper(found(plate([Cell(profile=(*arc, (0, -THICK)))], 48)))
    assert opening.radius_mm == pytest.approx(5.0, abs=EXACT)
    assert opening.centre_mm[2] == pytest.approx(0.0, abs=0.03)


def test_noise_of_a_scan_moves_little():
    mesh = plate([HOLE, BLIND, PIN], 64)
    first = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)[1].reshape(-1)
    noise = np.random.default_rng(1).normal(0.0, 0.005, (first.max() + 1, 3))
    openings = found(replace(mesh, vertices=mesh.vertices + noise[first]))
    assert len(openings) == 3
    for opening in upper(openings):
        assert opening.radius_mm == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("noise_mm", [0.002, 0.01])
def test_a_finely_cut_noisy_scan_is_smoothed(noise_mm):
    soup = mend_mesh(plate([Cell(radius=8.0), BLIND], 64)).mesh
    vertices, faces = trimesh.remesh.subdivide_to_size(soup.vertices, soup.faces, 1.0)
    noise = np.random.default_rng(3).normal(0.0, noise_mm, vertices.shape)
    openings = found(Mesh(vertices=vertices + noise, faces=faces.astype(np.int32)))
    assert len(openings) == 3
    for opening, radius in zip(upper(openings), (8.0, 5.0), strict=True):
        assert opening.radius_mm == pytest.approx(radius, abs=0.02)
        assert opening.centre_mm[2] == pytest.approx(0.0, abs=0.1)


def test_a_bowl_is_no_hole():
    turn = np.linspace(0, math.pi / 2, 19)[:-1]
    bowl = [(10 * math.cos(a) - 5, -9 * math.sin(a)) for a in turn]
    search = find_holes(mend_mesh(plate([Cell(profile=bowl, closed=True)], 64)))
    assert not search.openings
    assert "1 opening left out" in search.notes[0]


def test_repeated_flipped_and_cracked_triangles_are_mended_and_counted():
    mesh = plate([HOLE, BLIND])
    rng = np.random.default_rng(2)
    faces = mesh.faces.copy()
    turned = rng.choice(len(faces), 40, replace=False)
    faces[turned] = faces[turned][:, ::-1]
    faces = np.concatenate([faces, faces[:7, [1, 2, 0]]])
    vertices = mesh.vertices + rng.uniform(-0.001, 0.001, mesh.vertices.shape)
    cracked = mend_mesh(Mesh(vertices=vertices, faces=faces))
    notes = " ".join(cracked.notes)
    assert "40 flipped triangles" in notes
    assert "cracks" in notes
    assert "7 repeated triangles" in " ".join(
        mend_mesh(Mesh(vertices=mesh.vertices, faces=faces)).notes
    )
    assert cracked.closed.all()
    assert len(find_holes(cracked).openings) == 3


def test_a_closed_surface_inside_out_is_turned():
    mesh = plate([HOLE, BLIND, PIN])
    (through, blind) = upper(found(replace(mesh, faces=mesh.faces[:, ::-1])))
    assert (through.depth, blind.depth) == ("through", "blind")


def test_missing_triangles_of_the_wall_or_floor_hide_no_hole():
    mesh = plate([HOLE, BLIND])
    away = mesh.vertices[mesh.faces].mean(axis=1)
    wall = np.flatnonzero(np.isclose(np.hypot(away[:, 0], away[:, 1]), 5.0, atol=0.1))
    faces = np.delete(mesh.faces, wall[:1], axis=0)
    assert len(found(replace(mesh, faces=faces))) == 3


def test_a_moebius_strip_is_refused():
    turns = 2 * math.pi * np.arange(40) / 40
    edges = np.stack(
        [
            np.column_stack(
                [
                    (20 + s * np.cos(turns / 2)) * np.cos(turns),
                    (20 + s * np.cos(turns / 2)) * np.sin(turns),
                    s * np.sin(turns / 2),
                ]
            )
            for s in (-3.0, 3.0)
        ],
        axis=1,
    )
    here = np.arange(40)
    following = np.column_stack([2 * here + 2, 2 * here + 3])
    following[-1] = (1, 0)  # its ends are joined upside down
    faces = np.concatenate(
        [
            np.column_stack([2 * here, following[:, 0], 2 * here + 1]),
            np.column_stack([following[:, 0], following[:, 1], 2 * here + 1]),
        ]
    ).astype(np.int32)
    with pytest.raises(FormatError, match="but one side"):
        mend_mesh(Mesh(vertices=edges.reshape(-1, 3), faces=faces))


def test_the_outline_of_a_sheet_is_no_hole():
    (opening,) = found(plate([HOLE], open_sheet=True))
    assert opening.depth == "sheet"


def test_an_octagon_is_a_circle_and_a_hexagon_none():
    assert upper(found(plate([HOLE], 8)))[0].radius_mm == pytest.approx(5.0, abs=EXACT)
    turn = 2 * math.pi * np.arange(6) / 6
    hexagon = 5 * np.column_stack([np.cos(turn), np.sin(turn)])
    edges = np.column_stack([np.arange(6), np.roll(np.arange(6), -1)])
    assert fit_rim(hexagon, edges) is None

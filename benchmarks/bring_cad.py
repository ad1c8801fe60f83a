"""The door's holes, found again in meshes of it: coarse, fine, through STEP, of 5 M triangles."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.bring_folder import call
from benchmarks.measuring import Figure, PeakMemory, at_least, at_most, say
from exposight.cell import Feature, read_features
from exposight.twin.part import door
from exposight.twin.part.car_door import DOOR, door_part
from exposight.twin.part.sheet_mesh import MeshSettings, mesh_sheet

_COARSE = MeshSettings(
    lattice_mm=12.0,
    fine_curvature_per_mm=0.05,
    rim_spacing_mm=1.5,
    border_spacing_mm=12.0,
    growth=1.8,
    arc_steps=1,
)
"""Fifty thousand triangles: as a CAD program writes the door for a preview."""
_NEAR_MM, _THICK_MM = 1.0, 2.0
_MANY = 5_000_000

Vertices: TypeAlias = NDArray[np.float64]
Faces: TypeAlias = NDArray[np.int32]


def write_stl(path: Path, vertices: Vertices, faces: Faces) -> None:
    """Write a binary STL file."""
    rows = np.zeros(len(faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("_", "<u2")])
    rows["corners"] = vertices[faces]
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + rows.tobytes())


def write_step(path: Path, vertices: Vertices, faces: Faces) -> None:
    """Write a faceted STEP file (ISO 10303-214), a plane for each triangle, in mm."""
    lines: list[str] = []

    def add(text: str) -> str:
        lines.append(text)
        return f"#{len(lines)}"

    def numbers(values: NDArray[np.float64]) -> str:
        return ",".join(f"{x:.12f}" for x in values)

    context = add("APPLICATION_CONTEXT('core data for automotive mechanical design processes')")
    add(
        "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,"
        f"{context})"
    )
    of_product = add(f"PRODUCT_CONTEXT('',{context},'mechanical')")
    product = add(f"PRODUCT('door','door','',({of_product}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    of_design = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{context},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',{formation},{of_design})")
    of_shape = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    length = add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    angle = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid = add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    accuracy = add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),{length},'accuracy','')")
    geometry = add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(("
        f"{accuracy}))GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid}))"
        "REPRESENTATION_CONTEXT('',''))"
    )
    points = [add(f"CARTESIAN_POINT('',({numbers(vertex)}))") for vertex in vertices]
    along = vertices[faces[:, 1]] - vertices[faces[:, 0]]
    normals = np.cross(along, vertices[faces[:, 2]] - vertices[faces[:, 0]])
    facets = []
    for corners, normal, edge in zip(
        faces.tolist(),
        normals / np.linalg.norm(normals, axis=1)[:, None],
        along / np.linalg.norm(along, axis=1)[:, None],
        strict=True,
    ):
        axis, direction = (
            add(f"DIRECTION('',({numbers(normal)}))"),
            add(f"DIRECTION('',({numbers(edge)}))"),
        )
        place = add(f"AXIS2_PLACEMENT_3D('',{points[corners[0]]},{axis},{direction})")
        loop = add(f"POLY_LOOP('',({','.join(points[i] for i in corners)}))")
        bound = add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        plane = add(f"PLANE('',{place})")
        facets.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(facets)}))")
    body = add(f"FACETED_BREP('door',{shell})")
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('door',({body}),{geometry})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({of_shape},{shape})")
    path.write_text(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
        "FILE_NAME('door','2026-01-01T00:00:00',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
        + "".join(f"#{number}={line};\n" for number, line in enumerate(lines, start=1))
        + "ENDSEC;\nEND-ISO-10303-21;\n"
    )


def compared(found: tuple[Feature, ...]) -> tuple[int, int, float]:
    """Compare what was found with the door's design.

    Returns
    -------
    int, int, float
        Holes that were found, holes that the door has not, the largest error of a radius in mm.
    """
    left = [feature for feature in found if feature.kind == "hole"]
    n_found, worst = 0, 0.0
    for hole in door_part().features:
        if hole.kind != "hole":
            continue
        inverse = hole.part_from_feature.inverse()
        for each in left:
            x, y, z = inverse.apply(each.part_from_feature.translation_mm[None])[0]
            if np.hypot(x, y) < _NEAR_MM and abs(z) < _THICK_MM:
                n_found += 1
                worst = max(worst, abs(each.radius_mm - hole.radius_mm))
                left.remove(each)
                break
    return n_found, len(left), worst


def _finer(vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Return every triangle as four."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    middles = index.reshape(-1, 3) + len(vertices)
    a, b, c = faces.T
    ab, bc, ca = middles.T
    finer = np.concatenate(
        [np.stack(corners, 1) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )
    return np.concatenate([vertices, vertices[unique].mean(axis=1)]), finer.astype(np.int32)


def cad() -> list[Figure]:
    """Find the door's holes in each mesh of it."""
    coarse, fine = mesh_sheet(DOOR, _COARSE), door()
    n_holes = sum(feature.kind == "hole" for feature in door_part().features)
    outcomes = []
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_stl(folder / "coarse.stl", coarse.vertices, coarse.faces)
        write_stl(folder / "fine.stl", fine.vertices, fine.faces)
        write_step(folder / "door.step", coarse.vertices, coarse.faces)
        for name in ("coarse.stl", "fine.stl", "door.step"):
            say(f"finding the door's holes in {name}")
            unit = [] if name.endswith("step") else ["--unit", "mm"]
            begun = time.perf_counter()
            call(["part", str(folder / name), *unit, "-o", str(folder / f"{name}-part")])
            seconds = time.perf_counter() - begun
            outcome = compared(read_features(folder / f"{name}-part" / "features.csv"))
            outcomes.append(outcome)
            stem = name.replace(".", "_")
            figures += [
                Figure(name=f"cad_{stem}_holes", value=outcome[0]),
                Figure(name=f"cad_{stem}_s", value=seconds, unit="s"),
            ]
        say("finding holes among five million triangles")
        vertices, faces = _finer(fine.vertices, fine.faces)
        write_stl(folder / "many.stl", vertices, faces)
        n_triangles = len(faces)
        del vertices, faces
        begun = time.perf_counter()
        with PeakMemory() as memory:
            call(["part", str(folder / "many.stl"), "--unit", "mm", "-o", str(folder / "many")])
        many_s = time.perf_counter() - begun
        outcomes.append(compared(read_features(folder / "many" / "features.csv")))
    return [
        *figures,
        at_least("cad_holes_found", min(outcome[0] for outcome in outcomes), n_holes),
        at_most("cad_false_holes", max(outcome[1] for outcome in outcomes), 0),
        at_most("cad_radius_error_mm", max(outcome[2] for outcome in outcomes), 0.02, "mm"),
        at_least("cad_5m_triangles", n_triangles, _MANY),
        at_most("cad_5m_triangles_s", many_s, 60.0, "s"),
        Figure(name="cad_5m_triangles_gb", value=memory.peak_gb, unit="GB"),
    ]

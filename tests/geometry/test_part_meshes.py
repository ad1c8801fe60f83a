"""Parts as people bring them: units, STEP, and files that are damaged."""

import numpy as np
import pytest
import trimesh
from tests.geometry.drilled_plates import BLIND, HOLE, PIN, plate
from tests.geometry.step_files import drilled_plate, facets

from exposight.errors import (
    AmbiguousError,
    DamagedFileError,
    FormatError,
    InputError,
    MissingFileError,
)
from exposight.files import Reading, reading_as
from exposight.geometry.meshes.mesh_holes import find_holes
from exposight.geometry.meshes.mesh_mending import mend_mesh
from exposight.geometry.meshes.triangle_meshes import mesh_to_ply, read_part_mesh

HOLES = [(30.0, 40.0, 5.0), (90.0, 50.0, 12.0), (150.0, 20.0, 3.0)]


@pytest.fixture(params=["stl", "obj", "ply", "glb"])
def exported(request, tmp_path):
    path = tmp_path / f"part.{request.param}"
    mesh = plate([HOLE])
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    return path


def extent(mesh):
    return np.ptp(mesh.vertices, axis=0)


def test_units_are_asked_for_but_of_glb(exported):
    if exported.suffix == ".glb":
        assert extent(read_part_mesh(exported)) == pytest.approx([40000, 40000, 10000])
        return
    with pytest.raises(AmbiguousError) as error:
        read_part_mesh(exported)
    assert error.value.readings == ("unit=mm", "unit=cm", "unit=m", "unit=inch")
    assert extent(read_part_mesh(exported, "inch")) == pytest.approx([1016, 1016, 254])
    with reading_as(Reading(unit="cm")):
        assert extent(read_part_mesh(exported)) == pytest.approx([400, 400, 100])


@pytest.mark.parametrize(
    ("name", "old", "new", "factor"),
    [
        ("a.obj", b"", b"# Units: inches\n", 25.4),
        ("a.ply", b"format", b"comment unit m\nformat", 1000.0),
        ("a.stl", b"\0" * 80, b"solid of a program, UNITS=cm".ljust(80), 10.0),
    ],
)
def test_a_comment_tells_the_unit(tmp_path, name, old, new, factor):
    path = tmp_path / name
    mesh = plate([HOLE])
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    data = path.read_bytes()
    if name == "a.stl":
        data = new + data[80:]
    elif name == "a.ply":
        data = data.replace(b"format", new, 1)
    else:
        data = new + data
    path.write_bytes(data)
    assert extent(read_part_mesh(path))[0] == pytest.approx(40 * factor)


def test_our_own_ply_is_in_mm(tmp_path):
    mesh = plate([HOLE])
    finish = np.zeros(len(mesh.faces), np.uint8)
    (tmp_path / "own.ply").write_bytes(mesh_to_ply(mesh.vertices, mesh.faces, finish, ["bare"]))
    assert extent(read_part_mesh(tmp_path / "own.ply"))[0] == pytest.approx(40)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("m", 1000.0), ("inch", 25.4)])
def test_step_in_its_own_unit(tmp_path, unit, scale):
    pytest.importorskip("cascadio")
    path = tmp_path / "plate.step"
    holes = [tuple(number / scale for number in hole) for hole in HOLES]
    path.write_text(drilled_plate((200 / scale, 100 / scale, 8 / scale), holes, unit))
    mesh = mend_mesh(read_part_mesh(path))
    assert mesh.closed.all()
    openings = [o for o in find_holes(mesh).openings if o.normal[2] > 0]
    assert len(openings) == 3
    for opening, (x, y, radius) in zip(
        sorted(openings, key=lambda o: o.centre_mm[0]), HOLES, strict=True
    ):
        assert opening.centre_mm == pytest.approx([x, y, 0], abs=1e-3)
        assert opening.radius_mm == pytest.approx(radius, abs=1e-3)
        assert opening.depth == "through"


def test_step_of_facets(tmp_path):
    pytest.importorskip("cascadio")
    mesh = mend_mesh(plate([HOLE, BLIND, PIN])).mesh
    (tmp_path / "a.stp").write_text(facets(mesh.vertices, mesh.faces))
    openings = find_holes(mend_mesh(read_part_mesh(tmp_path / "a.stp"))).openings
    assert sorted(o.depth for o in openings) == ["blind", "through", "through"]


def test_step_that_is_none(tmp_path):
    path = tmp_path / "a.step"
    with pytest.raises(MissingFileError):
        read_part_mesh(path)
    path.write_text("solid of an STL file")
    with pytest.raises(FormatError, match="ISO-10303-21"):
        read_part_mesh(path)
    path.write_text(drilled_plate((20, 10, 2), [])[:-40])
    with pytest.raises(DamagedFileError, match="end of the STEP file"):
        read_part_mesh(path)
    path.write_text(drilled_plate((20, 10, 2), []))
    with pytest.raises(InputError, match="unit itself"):
        read_part_mesh(path, "mm")


def test_step_without_the_extra_names_it(tmp_path, monkeypatch):
    monkeypatch.setattr("exposight.geometry.meshes.triangle_meshes.find_spec", lambda _: None)
    (tmp_path / "a.step").write_text(drilled_plate((20, 10, 2), []))
    with pytest.raises(FormatError, match=r"exposight\[cad\]"):
        read_part_mesh(tmp_path / "a.step")


def test_a_step_file_without_a_body_is_refused(tmp_path):
    pytest.importorskip("cascadio")
    lines = drilled_plate((20, 10, 2), []).splitlines()
    body = [line for line in lines if "MANIFOLD" not in line and "CLOSED_SHELL" not in line]
    (tmp_path / "a.step").write_text("\n".join(body) + "\n")
    with pytest.raises(FormatError, match="holds no triangles"):
        read_part_mesh(tmp_path / "a.step")


def test_nan_is_refused(tmp_path):
    data = bytearray(trimesh.creation.box((1, 2, 3)).export(file_type="stl"))
    data[96:100] = np.float32(np.nan).tobytes()
    (tmp_path / "a.stl").write_bytes(bytes(data))
    with pytest.raises(FormatError, match="NaN"):
        read_part_mesh(tmp_path / "a.stl", "mm")

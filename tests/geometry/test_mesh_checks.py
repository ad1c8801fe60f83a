"""Meshes whose headers announce what is not there, or far too much, are refused unread."""

import json
import struct

import numpy as np
import pytest
import trimesh

from exposight.errors import FormatError
from exposight.geometry.meshes.triangle_meshes import read_mesh

BOX = trimesh.creation.box((30.0, 20.0, 10.0))


def glb(change):
    """Return a GLB whose JSON was changed, with right lengths."""
    data = BOX.export(file_type="glb")
    (length,) = struct.unpack_from("<I", data, 12)
    tree = json.loads(data[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = b"glTF" + struct.pack("<IIII", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest


def doubled(tree):
    start = len(tree["nodes"])
    tree["nodes"] += [{"children": [start + k + 1] * 2} for k in range(40)] + [{"mesh": 0}]
    tree["scenes"][0]["nodes"].append(start)


def billion(tree):
    del tree["accessors"][0]["bufferView"]
    tree["accessors"][0]["count"] = 10**9


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (doubled, "two parents"),
        (billion, "compressed or sparse"),
        (lambda tree: tree["accessors"][0].update(count=-1), "expected a count"),
        (lambda tree: tree["accessors"][0].update(count=2**62), "is not in its bytes"),
        (lambda tree: tree["bufferViews"][0].update(byteLength=10**9), "beyond its end"),
        (lambda tree: tree["nodes"].extend([{"children": [len(tree["nodes"])]}]), "in a circle"),
    ],
)
def test_a_glb_is_held_against_its_bytes(tmp_path, change, fact):
    path = tmp_path / "part.glb"
    path.write_bytes(glb(change))
    with pytest.raises(FormatError, match=rf"part\.glb.*{fact}"):
        read_mesh(path)


def test_a_glb_that_is_whole_is_read(tmp_path):
    path = tmp_path / "part.glb"
    path.write_bytes(glb(lambda _: None))
    assert len(read_mesh(path).faces) == 12


@pytest.mark.parametrize("line", ["vertex -8", "vertex 99999999999", "face 1000000000", "face 1_2"])
def test_a_ply_is_held_against_its_bytes(tmp_path, line):
    data = BOX.export(file_type="ply")
    name = line.split()[0]
    count = {"vertex": 8, "face": 12}[name]
    path = tmp_path / "part.ply"
    path.write_bytes(data.replace(f"{name} {count}\n".encode(), f"{line}\n".encode()))
    with pytest.raises(FormatError, match=r"part\.ply"):
        read_mesh(path)


@pytest.mark.parametrize("face", ["0 1 2", "9 1 2", "-9 1 2", "1 2 x", "1 2 99999999999999999999"])
def test_corners_of_an_obj_are_its_vertices(tmp_path, face):
    path = tmp_path / "part.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf {face}\n")
    with pytest.raises(FormatError, match=r"part\.obj"):
        read_mesh(path)


def test_stl_as_text_is_read_whole_or_not_at_all(tmp_path):
    path = tmp_path / "part.stl"
    text = BOX.export(file_type="stl_ascii")
    path.write_text(text)
    np.testing.assert_allclose(np.ptp(read_mesh(path).vertices, axis=0), (30.0, 20.0, 10.0))
    for wrong in (text.replace("vertex", "vortex", 1), text[:-200], text.replace("15", "1x", 1)):
        path.write_text(wrong)
        with pytest.raises(FormatError, match=r"part\.stl is not a readable STL mesh"):
            read_mesh(path)

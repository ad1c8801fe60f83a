"""A surface of few triangles that is still the part's."""

import numpy as np
import pytest
import trimesh

from exposight.service.shown_surface import coarse_surface, read_surface, write_surface


@pytest.mark.parametrize("most", [200, 3000])
def test_a_coarse_surface_stays_where_the_fine_one_is(most):
    ball = trimesh.creation.icosphere(subdivisions=6, radius=100.0)
    surface = coarse_surface(ball.vertices, ball.faces.astype(np.int32), most)
    points = np.reshape(surface["vertices"], (-1, 3))
    triangles = np.reshape(surface["triangles"], (-1, 3))
    assert most / 3 < len(triangles) <= most
    assert set(triangles.ravel()) == set(range(len(points)))
    assert np.linalg.norm(points, axis=1) == pytest.approx(100.0, rel=0.15)
    assert len(surface["shade"]) == len(points)


def test_a_surface_beside_a_run_is_read_and_stays(tmp_path):
    box = trimesh.creation.box((10.0, 20.0, 30.0))
    assert read_surface(tmp_path) is None
    write_surface(tmp_path, box.vertices, box.faces.astype(np.int32))
    first = read_surface(tmp_path)
    assert len(first["triangles"]) == 36
    write_surface(tmp_path, 2 * box.vertices, box.faces.astype(np.int32))
    assert read_surface(tmp_path) == first
    (tmp_path / "surface.json").write_text("[")
    assert read_surface(tmp_path) is None

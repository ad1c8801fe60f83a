"""The built-in door's 35 holes are found in its mesh, however finely it is cut."""

from dataclasses import replace

import numpy as np
import pytest

from exposight.geometry.meshes.mesh_holes import find_holes
from exposight.geometry.meshes.mesh_mending import mend_mesh
from exposight.geometry.meshes.triangle_meshes import Mesh
from exposight.twin.part import DOOR, DOOR_MESH, mesh_sheet
from exposight.twin.part.car_door import door_part

COARSE = replace(
    DOOR_MESH, lattice_mm=8, rim_spacing_mm=1.2, border_spacing_mm=4, growth=1.5, arc_steps=1
)


@pytest.mark.slow
@pytest.mark.parametrize("arc_steps", [1, 3])
def test_every_hole_of_the_door_and_no_other(arc_steps):
    sheet = mesh_sheet(DOOR, replace(COARSE, arc_steps=arc_steps))
    openings = find_holes(mend_mesh(Mesh(vertices=sheet.vertices, faces=sheet.faces))).openings
    for kind, outline in (("hole", "circle"), ("slot", "slot")):
        listed = [feature for feature in door_part().features if feature.kind == kind]
        found = [opening for opening in openings if opening.outline == outline]
        assert len(found) == 2 * len(listed)
        for feature in listed:
            pose = feature.part_from_feature
            facing = [opening for opening in found if opening.normal @ pose.z_axis < 0]
            near = min(facing, key=lambda o: np.linalg.norm(o.centre_mm - pose.translation_mm))
            # The door is crowned: a large hole's rim lies below the surface at its centre.
            assert near.centre_mm == pytest.approx(pose.translation_mm, abs=0.3)
            assert near.radius_mm == pytest.approx(feature.radius_mm, abs=0.02)

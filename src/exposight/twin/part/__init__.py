"""What light falls on: sheet metal, its shape as a closed mesh, its finishes, its features."""

from exposight.twin.part.door_scene import build_door, door, door_part
from exposight.twin.part.door_shape import DOOR, DOOR_MESH, OUTSIDE_ZONES
from exposight.twin.part.presses import Bead, Pocket, Press, PressProfile, RingBead, RoundedPolygon
from exposight.twin.part.scene import Scene, check_scene
from exposight.twin.part.scene_files import (
    FEATURES_FILE,
    MESH_FILE,
    SENSOR_FILE,
    export_scene,
    read_scene,
)
from exposight.twin.part.sheet_mesh import MeshSettings, SheetMesh, mesh_sheet
from exposight.twin.part.sheet_shape import Hole, SheetShape
from exposight.twin.part.surfaces import FINISHES, SURFACES, Finish, Surface

"""What light falls on: sheet metal, its shape as a closed mesh, its finishes, its features."""

from exposight.twin.part.car_door import DOOR, DOOR_MESH, OUTSIDE_ZONES, door
from exposight.twin.part.finishes import Finishes, Zone
from exposight.twin.part.presses import Bead, Pocket, PressProfile, RingBead, RoundedPolygon
from exposight.twin.part.scene import (
    FEATURES_FILE,
    MESH_FILE,
    SENSOR_FILE,
    Scene,
    check_scene,
    export_scene,
    read_scene,
)
from exposight.twin.part.sheet_mesh import MeshSettings, mesh_sheet
from exposight.twin.part.sheet_shape import Hole, SheetShape
from exposight.twin.part.surfaces import FINISHES, SURFACES, ClearCoat, Finish, SecondLobe, Surface

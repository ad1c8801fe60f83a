"""What light falls on: the built-in sheet or any other mesh, its finishes, its features."""

from exposight.twin.part.car_door import DOOR, DOOR_MESH, OUTSIDE_ZONES, door
from exposight.twin.part.finishes import Finishes, Zone
from exposight.twin.part.presses import Bead, Pocket, PressProfile, RingBead, RoundedPolygon
from exposight.twin.part.scene import Scene, check_scene
from exposight.twin.part.scene_files import (
    FEATURES_FILE,
    SCENE_FILE,
    SENSOR_FILE,
    SceneDocument,
    export_scene,
    exported_files,
    find_scene,
    is_scene,
    read_scene,
    scene_sensor,
)
from exposight.twin.part.sheet_mesh import MeshSettings, mesh_sheet
from exposight.twin.part.sheet_shape import Hole, SheetShape
from exposight.twin.part.surfaces import FINISHES, SURFACES, ClearCoat, Finish, SecondLobe, Surface

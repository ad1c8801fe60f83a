"""Pure geometry: rigid transforms, pinhole cameras, hollow cylinders. No sensor in it."""

from exposight.geometry.calibration_files import (
    KNOWN_KEYS,
    CalibrationKeys,
    ProjectorCamera,
    read_opencv_file,
    read_projector_camera,
)
from exposight.geometry.camera_info import ImageKind, read_camera_info, read_ros_camera_info
from exposight.geometry.cameras import PinholeCamera
from exposight.geometry.cylinders import (
    HollowCylinder,
    PixelBox,
    count_points_inside,
    outlines_in_camera,
    packed_boxes,
    packed_cylinders,
    pixel_boxes,
    ring_pixels,
)
from exposight.geometry.image_grids import averaged_camera, grid_camera, grid_ratio
from exposight.geometry.poses import RigidTransform, check_points, check_rotation, rotation_facing
from exposight.geometry.stereo_calibrations import (
    StereoCameras,
    is_stereo_file,
    read_stereo_cameras,
)
from exposight.geometry.written_poses import (
    PoseNotation,
    parse_pose,
    pose_columns,
    pose_from_numbers,
    read_pose,
)

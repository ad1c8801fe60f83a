"""Pure geometry: rigid transforms, pinhole cameras, hollow cylinders. No sensor in it."""

from exposight.geometry.calibrations.calibration import Calibration, ImageKind
from exposight.geometry.calibrations.calibration_files import (
    ProjectorCamera,
    projector_camera,
    read_calibration,
    read_projector_camera,
    read_stereo_cameras,
)
from exposight.geometry.calibrations.calibration_nodes import (
    CalibrationKeys,
    CalibrationNodes,
    read_calibration_nodes,
)
from exposight.geometry.calibrations.camera_info import read_camera_info, read_ros_camera_info
from exposight.geometry.calibrations.stereo_calibrations import StereoCameras
from exposight.geometry.calibrations.uncalibrated import uncalibrated_camera
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
from exposight.geometry.poses import (
    RigidTransform,
    StackedPoses,
    check_points,
    check_rotation,
    rotation_facing,
)
from exposight.geometry.robot_poses.pose_chains import (
    camera_from_held_part,
    camera_from_part_of,
    other_chains,
    other_poses,
)
from exposight.geometry.robot_poses.pose_files import parse_pose, read_named_poses, read_pose
from exposight.geometry.robot_poses.pose_notations import (
    PoseNotation,
    check_length_unit,
    pose_columns,
    pose_from_numbers,
)
from exposight.geometry.robot_poses.pose_tables import is_pose_header, poses_of_table

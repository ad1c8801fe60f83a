"""What is measured about a hole: p_norm, i_avg and pose, on a plate without a sensor's faults.

A cloud with a point for every pixel is made of a flat, tilted plate; then the left half of it is
taken away, as clipping would. p_norm falls from 1 to about a half.
"""

import numpy as np

from exposight.cell import Capture, Cloud, Feature, MemoryCampaign, Part, sensor_preset
from exposight.geometry import RigidTransform
from exposight.observing import observe_campaign

sensor = sensor_preset("comet-pro-ae")
camera_from_part = sensor.camera_from_tcp @ RigidTransform.from_fanuc_wpr([0, 0, 0], 10.0, 0.0, 0.0)
part = Part(
    name="plate",
    features=(Feature(name="f1", kind="hole", part_from_feature=RigidTransform(), radius_mm=10.0),),
)

# every camera ray meets the plate somewhere: that is a perfect organised cloud
rays = sensor.camera.rays()
normal = camera_from_part.z_axis
depth_mm = normal @ camera_from_part.translation_mm / (rays @ normal[:2] + normal[2])
perfect = np.concatenate([rays * depth_mm[..., None], depth_mm[..., None]], axis=2)
half = np.where(perfect[..., :1] < 0, np.nan, perfect)

for name, points in (("perfect", perfect), ("left half missing", half)):
    capture = Capture(
        view="front",
        exposure_ms=20.0,
        image=np.full(rays.shape[:2], 80, dtype=np.uint8),
        cloud=Cloud(points=points),
        camera_from_part=camera_from_part,
    )
    campaign = MemoryCampaign(name=name, sensor=sensor, part=part, captures=[capture])
    row = observe_campaign(campaign).frame.row(0, named=True)
    print(
        f"{name}: p_norm {row['p_norm']:.3f} ({row['n_points']} of {row['n_pixels']}), "
        f"i_avg {row['i_avg']:.0f}, z {row['z_mm']:.1f} mm, w {row['w_deg']:.1f}°"
    )

"""A driver of one's own: whatever takes an image and a cloud can be measured with.

The cell is a flat plate: pixels brighten with exposure time until they clip, and a pixel gives a
point between 10 and 254 grey levels. `exposight.measuring.measure` does the rest: order, files,
resuming.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import exposight as xs
from exposight.plans import MeasuringPlan, PoseList

HOLE = xs.Feature(name="f1", kind="hole", part_from_feature=xs.RigidTransform(), radius_mm=10.0)


class Plate:
    """A measuring cell; `exposight.cell.driver` describes the contract."""

    sensor = xs.sensor_preset("rc-visard-65")
    part = xs.Part(name="plate", features=(HOLE,))

    def capture(
        self, exposure_ms: float, camera_from_part: xs.RigidTransform, *, view: str
    ) -> xs.Capture:
        """Take a capture: every pixel's ray meets the plate."""
        rays = self.sensor.camera.rays()
        normal = camera_from_part.z_axis
        depth_mm = normal @ camera_from_part.translation_mm / (rays @ normal[:2] + normal[2])
        brightness = 20.0 * exposure_ms * (500.0 / depth_mm) ** 2  # the inverse square of distance
        points = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=2) * depth_mm[..., None]
        points[(brightness < 10.0) | (brightness > 254.0)] = np.nan
        return xs.Capture(
            view=view,
            exposure_ms=exposure_ms,
            image=np.clip(brightness, 0, 255).round().astype(np.uint8),
            cloud=xs.Cloud(points=points),
            camera_from_part=camera_from_part,
        )


pose = Plate.sensor.camera_from_tcp @ xs.RigidTransform.from_fanuc_wpr([0, 0, 0], 10.0, 0.0, 0.0)
views = PoseList.from_transforms("tilted", [pose], exposures_ms=(0.2, 5.0, 15.0))
plan = MeasuringPlan(name="plate", sensor=Plate.sensor, features=("f1",), poses=(views,))
with TemporaryDirectory() as folder:
    xs.measure(plan, Plate(), Path(folder) / "plate")
    table = xs.open_campaign(Path(folder) / "plate").observe()
for row in table.frame.iter_rows(named=True):
    print(f"{row['exposure_ms']} ms: i_avg {row['i_avg']:.0f}, p_norm {row['p_norm']:.2f}")

"""Predicted over measured standard deviation of depth, over repeats of the simulated cell.

A square of the paper's sensor's image sees a tilted plate in primer; only the noise differs between
the repeats. Each repeat predicts from its own frames alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from exposight.cell import sensor_preset
from exposight.geometry import PixelBox, RigidTransform
from exposight.imaging import noise_of_frames, triangulate, with_sigma_z
from exposight.twin import sensors
from exposight.twin.cell_settings import SimulatedCellSettings
from exposight.twin.light import SceneTracer, projector_of
from exposight.twin.matt_white import flat_plate
from exposight.twin.part import SURFACES
from exposight.twin.simulated_cell import sensor_model

_PRESET, _HALF_PX = "comet-pro-ae", 64
_TILT_DEG = (3.0, -5.0)
_MEAN_SHARE = 0.3
"""Mean brightness of the plate, of full scale: the fringes' crests stay below it."""


def sigma_z_ratio(repeats: int = 30) -> float:
    """Return the median over points of predicted over measured standard deviation of z.

    Parameters
    ----------
    repeats : int
        Captures of the same pose; at least two.
    """
    sensor = sensor_preset(_PRESET)
    model = sensor_model(sensor, SimulatedCellSettings())
    if not isinstance(model, sensors.StripeSensor):
        raise TypeError(_PRESET)
    tcp, camera = sensor.camera_from_tcp, sensor.camera
    pose = RigidTransform.from_fanuc_wpr(tcp.translation_mm, *_TILT_DEG, 0.0)
    ((u, v),) = np.rint(camera.project(tcp.translation_mm[None])).astype(int).tolist()
    box = PixelBox(top=v - _HALF_PX, bottom=v + _HALF_PX, left=u - _HALF_PX, right=u + _HALF_PX)
    light = model.look(SceneTracer(flat_plate(sensor, SURFACES["primer"])), pose, [box])
    electronics = model.electronics
    per_ms = float(np.median(light.tiles[0].even)) * electronics.electrons_per_ms
    exposure_ms = sensor.nearest_exposure(_MEAN_SHARE * electronics.full_well_e / per_ms)
    poses: dict[str, Any] = {
        "projector": projector_of(sensor).camera,
        "projector_from_camera": projector_of(sensor).camera_from_projector.inverse(),
    }
    depth, predicted = [], []
    for number in range(repeats):
        (stack,) = model.frames(light, exposure_ms, (number,))
        decoded = model.decode(stack)
        noise = noise_of_frames(stack, model.sequence, decoded)
        if noise is None:
            return float("nan")
        cloud = triangulate(decoded, camera=camera, window=box, **poses)
        cloud = with_sigma_z(cloud, stack, model.sequence, noise, **poses)
        depth.append(cloud.points[..., 2].astype(np.float64))
        predicted.append(np.asarray(cloud.sigma_z_mm, dtype=np.float64))
    measured = np.std(depth, axis=0, ddof=1)
    ratio = np.sqrt(np.mean(np.square(predicted), axis=0)) / measured
    return float(np.nanmedian(ratio))


if __name__ == "__main__":
    print(f"sigma_z_ratio {sigma_z_ratio():.3f}")

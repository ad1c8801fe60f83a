"""A plate before the paper's sensor, in a world of two formulas: brightness, and where points are.

Light falls off by the inverse square of the distance to the camera, one finish is brighter than
another, and points are there between two brightnesses.
"""

import numpy as np
import polars as pl
import pytest
from scipy.special import ndtr

from exposight.cell import Feature, Part, sensor_preset
from exposight.geometry import RigidTransform
from exposight.observing import ObservationTable, View
from exposight.planning import train

SENSOR = sensor_preset("comet-pro-ae")
LOW, HIGH = 20.0, 240.0
TIMES_MS = (2.0, 5.0, 12.0, 30.0, 80.0, 200.0)
LIGHT = {"bare": 2.0, "paint": 0.5}


def plate(finish: str = "bare") -> Part:
    """Nine holes in a plane."""
    places = [(x, y) for y in (-60.0, 0.0, 60.0) for x in (-90.0, 0.0, 90.0)]
    return Part(
        name="plate",
        features=tuple(
            Feature(
                name=f"f{number}",
                kind="hole",
                part_from_feature=RigidTransform(translation_mm=np.array([x, y, 0.0])),
                radius_mm=5.0,
                finish=finish,
            )
            for number, (x, y) in enumerate(places, start=1)
        ),
    )


def view_of(name: str, z_mm=600.0, w_deg=0.0, p_deg=0.0, finish="bare", sensor=SENSOR) -> View:
    """What the sensor sees of the plate at a distance."""
    pose = RigidTransform.from_fanuc_wpr((0.0, 0.0, z_mm), w_deg, p_deg, 0.0)
    return View.of(plate(finish), sensor, pose, name=name)


def radiance(frame: pl.DataFrame) -> np.ndarray:
    """Grey levels per ms of rings."""
    x, y, z = frame.select("x_mm", "y_mm", "z_mm").to_numpy().T
    light = np.array([LIGHT[finish] for finish in frame["finish"]])
    return light * 600.0**2 / (x**2 + y**2 + (z + 600.0) ** 2)


def observed(views, times_ms=TIMES_MS, noise=0.01, seed=1) -> ObservationTable:
    """Captures of views at all times."""
    rng = np.random.default_rng(seed)
    frames = []
    for view in views:
        frame = view.frame
        for time_ms in times_ms:
            spread = np.exp(noise * rng.standard_normal(frame.height))
            grey = radiance(frame) * time_ms * spread
            p_norm = ndtr(np.log(HIGH / grey) / 0.05) * ndtr(np.log(grey / LOW) / 0.05)
            frames.append(
                frame.with_columns(
                    pl.lit(time_ms).alias("exposure_ms"),
                    pl.Series("p_norm", p_norm),
                    pl.Series("i_avg", np.minimum(grey, 255.0)),
                    pl.Series("i_mean", np.minimum(grey, 255.0)),
                    pl.Series("clipped_share", (grey > 255.0).astype(np.float64)),
                    pl.lit("stripes-mean").alias("brightness_source"),
                )
            )
    return ObservationTable.from_frame(pl.concat(frames))


@pytest.fixture(scope="session")
def world() -> ObservationTable:
    """Eight views of the bare plate."""
    tilts = [(z, w, p) for z in (520.0, 680.0) for w in (-12.0, 12.0) for p in (-12.0, 12.0)]
    return observed([view_of(f"v{i}", *tilt) for i, tilt in enumerate(tilts)])


@pytest.fixture(scope="session")
def view():
    """Return what makes views (`view_of`)."""
    return view_of


@pytest.fixture(scope="session")
def capture():
    """Return what observes views (`observed`)."""
    return observed


@pytest.fixture(scope="session")
def light():
    """Return the world's radiance of rings."""
    return radiance


@pytest.fixture(scope="session")
def default_models(world):
    """The default models of the bare plate."""
    return train(world)

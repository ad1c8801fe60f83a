"""A plate of four holes, two bright and two dark, two views of it, and who captures them."""

import numpy as np
import pytest

from exposight.cell import ActiveSensor, Capture, Cloud, ExposureRange, Feature, Part
from exposight.geometry import PinholeCamera, RigidTransform
from exposight.planning import CaptureCosts, ExposureLimits, FeatureOutlook, PlannedExposure
from exposight.planning.exposure_plan import Certificate, ExposurePlan, PlanView, Promise

ROWS, COLUMNS = 180, 240


def plate_sensor(name="small"):
    camera = PinholeCamera(width=COLUMNS, height=ROWS, fx=300.0, fy=300.0, cx=119.5, cy=89.5)
    return ActiveSensor(
        name=name,
        cameras=(camera,),
        first_from_camera=(RigidTransform(),),
        projector=None,
        camera_from_tcp=RigidTransform(translation_mm=np.array([0.0, 0.0, 600.0])),
        exposure=ExposureRange(min_ms=0.5, max_ms=50.0, increment_ms=0.5),
        working_distance_mm=(400.0, 800.0),
    )


def plate_part():
    places = {"b1": (-150, -60), "b2": (-50, 60), "d1": (50, -60), "d2": (150, 60)}
    return Part(
        name="plate",
        features=tuple(
            Feature(
                name=name,
                kind="hole",
                part_from_feature=RigidTransform(translation_mm=np.array([x, y, 0.0])),
                radius_mm=5.0,
            )
            for name, (x, y) in places.items()
        ),
    )


def pose_at(distance_mm):
    return RigidTransform(translation_mm=np.array([0.0, 0.0, distance_mm]))


class PlateDriver:
    """The left half is eight times as bright as the right; no point where dark or clipped."""

    def __init__(
        self, name="small", read_back=lambda ms: ms, shift_mm=0.0, fail_at=None, light=1.0
    ):
        self.sensor, self.part = plate_sensor(name), plate_part()
        self.taken, self._light = [], light
        self._read_back, self._shift_mm, self._fail_at = read_back, shift_mm, fail_at

    def capture(self, exposure_ms, camera_from_part, *, view):
        if len(self.taken) == self._fail_at:
            self._fail_at = None
            raise RuntimeError("lost trigger")
        self.taken.append((view, exposure_ms))
        set_ms, height_mm = self._read_back(exposure_ms), camera_from_part.translation_mm[2]
        v, u = np.mgrid[0:ROWS, 0:COLUMNS]
        x, y = (u - 119.5) / 300.0, (v - 89.5) / 300.0
        light = self._light * (600.0 / height_mm) ** 2 * np.where(x < 0, 8.0, 1.0)
        grey = np.clip(np.rint(12.0 * set_ms * light), 0, 255)
        points = np.stack([x, y, np.ones_like(x)], axis=-1) * height_mm
        points[(grey < 20) | (grey > 250)] = np.nan
        aside = RigidTransform(translation_mm=np.array([self._shift_mm, 0.0, 0.0]))
        return Capture(
            view=view,
            exposure_ms=set_ms,
            image=grey.astype(np.uint8),
            cloud=Cloud(points=points),
            camera_from_part=aside @ camera_from_part,
        )


@pytest.fixture
def plate_driver():
    """Return what makes drivers before the plate."""
    return PlateDriver


def plate_exposure_plan():
    """Two captures that serve all, and one more."""
    limits = ExposureLimits.of(plate_sensor())

    def view(name, distance_mm, *times_ms):
        exposures = tuple(
            PlannedExposure(exposure_ms=t, set_value=t, set_unit="ms", order=order, covers=())
            for order, t in enumerate(times_ms, start=1)
        )
        return PlanView(name=name, camera_from_part=pose_at(distance_mm), exposures=exposures)

    return ExposurePlan(
        sensor="small",
        part="plate",
        target_p_norm=0.75,
        confidence=0.9,
        goal="count",
        limits=limits,
        costs=CaptureCosts(),
        views=(view("near", 600.0, 1.0, 10.0), view("far", 640.0, 12.0)),
        features=tuple(
            FeatureOutlook(
                feature=name,
                status="planned",
                chance=0.975,
                view="near",
                exposure_ms=1.0 if name[0] == "b" else 10.0,
            )
            for name in ("b1", "b2", "d1", "d2")
        ),
        promise=Promise(
            expected_covered=3.9,
            expected_misses=0.1,
            chance_of_all=0.9,
            chance_of_all_if_independent=0.9,
            correlation="one capture",
        ),
        certificate=Certificate(
            objective=3, bound=2, unit="captures", gap=1 / 3, proven=False, seconds=0.1
        ),
    )


@pytest.fixture
def plate_plan():
    return plate_exposure_plan()

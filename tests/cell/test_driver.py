from exposight.cell import ActiveSensor, Capture, Driver
from exposight.geometry import RigidTransform


class Cell:
    """A driver of another program: it inherits from nothing."""

    def __init__(self, sensor: ActiveSensor, capture: Capture) -> None:
        self.sensor = sensor
        self._capture = capture

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        return self._capture


def test_a_class_with_sensor_and_capture_is_a_driver(sensor, make_capture):
    driver: Driver = Cell(sensor, make_capture(10.5))
    assert driver.capture(10.0, RigidTransform(), view="v1").exposure_ms == 10.5

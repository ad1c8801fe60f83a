"""The contract between exposight and a measuring cell: a driver takes one capture at a time.

Whatever can take an image and a point cloud at a chosen exposure time and pose can be measured
with: the simulated cell, a recorded campaign that is replayed, a real sensor. To connect another
one, write a class with these two members; no base class is needed. ::

    class MyCell:
        sensor = read_sensor(Path("sensor.json"))

        def capture(self, exposure_ms, camera_from_part, *, view):
            self.robot.move_to(camera_from_part)
            self.camera.exposure_us = 1000.0 * exposure_ms
            image, points = self.camera.grab()
            return Capture(
                view=view,
                exposure_ms=self.camera.exposure_us / 1000.0,  # as set, not as asked for
                image=image,
                cloud=Cloud(points=points),
                camera_from_part=self.robot.camera_from_part(),  # as reported
            )

A driver that has all frames of the pattern keeps what they tell of each pixel, as
``Capture(…, stack=stack_images(frames, sequence, decoded))`` (`exposight.imaging`), and says what
its image is (``brightness_source``).

A driver does one thing. Choosing views and exposure times, resuming an interrupted campaign,
locking its folder, writing and verifying files, and distributing views over processes belong to the
loop that calls it (`exposight.measuring`).

Optional members, which the loop looks up by name:

``part`` : Part
    What is measured, if the driver knows it; otherwise the caller passes it.
``concurrent`` : bool
    True if copies of the driver in other processes may capture at the same time. The driver must
    then be picklable. A cell with one robot and one sensor leaves it out.
``description()`` : dict
    JSON-able facts that decide the bytes of captures beyond sensor, part and plan, such as gain or
    firmware. An interrupted campaign only continues with an equal description; its key ``driver``
    names the kind of cell.
``campaign_files()`` : mapping of str to bytes
    Further files for the campaign's folder, by name, such as what raw frames mean.
``exposure_share`` : float
    By which share captures' exposure times may differ from those asked for, where that is more than
    `same_exposure` allows: a recording gives the nearest that it has.
``close()``
    Restores the settings that the device had, and lets go of it. Who made the driver calls it when
    the captures are taken, whatever happens (`closing_driver`): ``exposight measure`` does, and so
    do Python callers; the loops use a driver as it is given. May be called twice.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

from exposight.cell.capture import Capture
from exposight.cell.sensor import ActiveSensor
from exposight.geometry import RigidTransform


class Driver(Protocol):
    """Something that takes captures: a real sensor, a simulated one, or a replayed campaign."""

    @property
    def sensor(self) -> ActiveSensor:
        """Cameras, lenses and possible exposure times of the sensor that takes the captures."""
        ...

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        """Move to a pose and take one capture.

        Called view by view; all exposure times of a view come one after another with the same pose,
        so a driver need not move again.

        Parameters
        ----------
        exposure_ms : float, ms
            Exposure time to take, within the sensor's range. What the sensor was really set to,
            read back from it, goes into the capture's `exposure_ms`; where that is not the
            `same_exposure`, the loop stops.
        camera_from_part : RigidTransform
            Wanted pose of the part in the first camera's frame, in mm. The pose that the cell
            reports goes into the capture's `camera_from_part`.
        view : str
            Name of this position; the capture gets it.

        Returns
        -------
        Capture
            Image, cloud in the first camera's frame in mm, exposure time and pose as read back.
            Further files to be kept with it, such as raw frames, are its `attachments`.

        Raises
        ------
        ExposightError
            If the capture cannot be taken; the loop stops, and what was captured stays valid. Any
            other exception is passed on likewise.
        """
        ...


_AnyDriver = TypeVar("_AnyDriver", bound=Driver)

ROUNDED_SHARE = 0.02
"""How much a device may round an exposure time, as a share of it: 1000 µs became 1015."""


def same_exposure(
    asked_ms: float, taken_ms: float, increment_ms: float, share: float = ROUNDED_SHARE
) -> bool:
    """Tell whether an exposure time read back is the one that was asked for, as devices round.

    Parameters
    ----------
    asked_ms, taken_ms : float, ms
        They may differ by the increment or by a share of what was asked for, whichever is more.
    increment_ms : float, ms
        The step between the sensor's settings.
    share : float
        2 % by default; a driver may allow more (`exposure_share`).
    """
    allowed_ms = max(increment_ms, share * asked_ms)
    return abs(asked_ms - taken_ms) <= allowed_ms * (1 + 1e-9)


def exposure_share(driver: Driver) -> float:
    """Return by which share a driver's exposure times may differ from those asked for."""
    return float(getattr(driver, "exposure_share", ROUNDED_SHARE))


@contextmanager
def closing_driver(driver: _AnyDriver) -> Iterator[_AnyDriver]:
    """Close a driver at the end, whatever happens, if it can be closed.

    Parameters
    ----------
    driver : Driver
        With or without a method ``close``.
    """
    try:
        yield driver
    finally:
        getattr(driver, "close", lambda: None)()

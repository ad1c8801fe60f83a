"""An rc_visard as a driver: exposure time by REST, left image and disparity by gRPC."""

from __future__ import annotations

from pathlib import Path

from exposight.cell import ActiveSensor, Capture, Part
from exposight.contradictions import settle
from exposight.drivers.cell_file import Cell, read_cell
from exposight.drivers.moves import Mover
from exposight.drivers.rc_visard_device import RcVisard
from exposight.drivers.rc_visard_images import ImageSet, fetch_image_set
from exposight.drivers.rc_visard_sensor import calibration_contradiction
from exposight.errors import SensorError
from exposight.geometry import RigidTransform, grid_ratio
from exposight.imaging import window_images
from exposight.rc_visard_messages import grpc_library


class RcVisardDriver:
    """An rc_visard of a cell's file (`exposight.cell.Driver`).

    The device matches its two images itself; what it delivers is its disparity, at the resolution
    that its quality setting gives (High: half the image's rows and columns). The device is reached
    at the first use and held until `close`.

    Parameters
    ----------
    cell : Cell
        Sensor, part, device and the command that moves.

    Raises
    ------
    SensorError
        If the cell has no rc_visard, its sensor has not two cameras, or gRPC is not installed.
    """

    def __init__(self, cell: Cell) -> None:
        if cell.file.rc_visard is None:
            msg = 'the cell\'s file names no rc_visard: give [rc_visard] with its host = "…"'
            raise SensorError(msg)
        if len(cell.sensor.cameras) != 2:
            msg = f"an rc_visard has two cameras, sensor {cell.sensor.name!r} has another number"
            raise SensorError(msg)
        grpc_library()  # before anything is set
        self._cell, self._settings = cell, cell.file.rc_visard
        self._mover = Mover(cell.file.move)
        self._device: RcVisard | None = None
        self._compared = False

    @classmethod
    def of_file(cls, path: str | Path) -> RcVisardDriver:
        """Return the driver of a cell's file.

        Raises
        ------
        FileError, SensorError
            As for `read_cell` and `RcVisardDriver`.
        """
        return cls(read_cell(path))

    @property
    def sensor(self) -> ActiveSensor:
        """The sensor of the cell's file."""
        return self._cell.sensor

    @property
    def part(self) -> Part | None:
        """The part of the cell's file, where it names one."""
        return self._cell.part

    @property
    def device(self) -> RcVisard:
        """The device, reached at the first use.

        Raises
        ------
        SensorError
            As for `RcVisard`.
        """
        if self._device is None:
            self._device = RcVisard(self._settings)
        return self._device

    def description(self) -> dict[str, object]:
        """Return what decides the captures, JSON-able."""
        return {"driver": "rc_visard", **self.device.description()}

    def close(self) -> None:
        """Restore the device's settings; the driver may be used again."""
        device, self._device = self._device, None
        if device is not None:
            device.close()

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        """Move, set the exposure time, and take the first image set that has it.

        Parameters
        ----------
        exposure_ms : float, ms
            The capture has the one that the image says.
        camera_from_part : RigidTransform
            The capture has the one that the ``[move]`` command printed, if it did.
        view : str

        Raises
        ------
        SensorError
            If device or command fail, a setting was ignored, or no image set comes in time.
        ContradictionError
            If the device's calibration is not the sensor's.
        """
        device, increment_ms = self.device, self.sensor.exposure.increment_ms
        reached = self._mover.move_to(camera_from_part, view)
        set_ms = device.set_exposure(exposure_ms, increment_ms)
        images = fetch_image_set(
            self._settings,
            exposure_ms=set_ms,
            increment_ms=increment_ms,
            not_before_s=device.time_s(),
        )
        self._check(images)
        return Capture(
            view=view,
            exposure_ms=images.exposure_ms,
            image=images.left,
            brightness_source="dots",
            stack=window_images(images.left, self._cell.file.stereo),
            cloud=images.cloud(),
            camera_from_part=reached,
            notes=self._mover.remark,
        )

    def _check(self, images: ImageSet) -> None:
        """Compare the device's calibration with the sensor's, at the first capture."""
        if not self._compared:
            settle([calibration_contradiction(self.sensor, images)])
            self._compared = True
        if grid_ratio(images.disparity.shape, images.left.shape) is None:
            rows, columns = images.disparity.shape
            msg = (
                f"the rc_visard's disparity has {rows} × {columns} px, which is no whole fraction "
                f"of its image's {images.left.shape[0]} × {images.left.shape[1]}"
            )
            raise SensorError(msg)

"""The simulated cell served as a GigE Vision camera, a projector and a robot, on loopback.

What a driver does with real devices is done with these: the camera speaks GigE Vision, projector
and robot are commands. The frames are those of `SimulatedCell.frames`, bit for bit.
"""

from __future__ import annotations

import logging
import shlex
import threading
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from exposight.cell import ExposureRange, Image, write_features, write_sensor
from exposight.errors import InputError, SensorError
from exposight.files import write_durably
from exposight.geometry import RigidTransform
from exposight.imaging import sequence_to_toml
from exposight.twin.gige_camera import GigeCamera
from exposight.twin.request_server import RequestServer, printed_pose, requested_pose
from exposight.twin.sensors import StripeSensor
from exposight.twin.simulated_cell import SimulatedCell, sensor_model

logger = logging.getLogger(__name__)

SERIAL = "EXPOSIGHT"
"""Serial number of the served camera."""

CELL_FILE = "cell.toml"

_FRAME_S = 30.0
"""A frame is simulated within this time, on a busy machine too."""


class ServedCell:
    """A simulated cell whose devices answer on loopback until it is closed.

    Parameters
    ----------
    cell : SimulatedCell
        With a sensor of one camera of 8 bits.
    folder : path
        Gets the files that a driver needs: ``cell.toml``, and beside it sensor, features and
        sequence.
    rounding_us : int, µs
        To whose multiples the camera rounds exposure times, as some do.

    Raises
    ------
    SensorError
        If the sensor is another one, Aravis is not installed, or another camera is served.
    FileError
        If the folder cannot be written.
    """

    def __init__(self, cell: SimulatedCell, folder: str | Path, *, rounding_us: int = 1) -> None:
        self._cell = cell
        self._folder = Path(folder).resolve()
        model = sensor_model(cell.sensor, cell.settings)
        if not isinstance(model, StripeSensor) or model.electronics.bit_depth != 8:
            msg = (
                f"sensor {cell.sensor.name!r} cannot be served: it needs one camera of 8 bits and "
                "a projector of stripes"
            )
            raise SensorError(msg)
        self._model = model
        self._lock = threading.Lock()
        self._at: tuple[str, RigidTransform] | None = None
        self._pattern = 0
        self._taken: tuple[object, Any] = (None, None)
        camera, exposure = cell.sensor.camera, cell.sensor.exposure
        self._folder.mkdir(parents=True, exist_ok=True)
        self._camera = GigeCamera(
            self._folder,
            SERIAL,
            (camera.height, camera.width),
            _in_microseconds(exposure),
            self.frame,
            rounding_us=rounding_us,
        )
        self._requests = RequestServer(self._folder, self._answer)
        self._write_files()

    def frame(self, exposure_ms: float) -> Image:
        """Return what the camera sees now at an exposure time; black before the first move."""
        with self._lock:
            if self._at is None:
                camera = self._cell.sensor.camera
                return np.zeros((camera.height, camera.width), dtype=np.uint8)
            return self._frames(exposure_ms)[self._pattern]  # type: ignore[no-any-return]

    def _frames(self, exposure_ms: float) -> Any:
        """Return the frames of the pose at an exposure time, computed once; the lock is held."""
        assert self._at is not None
        view, pose = self._at
        if self._taken[0] != (view, pose, exposure_ms):
            stack = self._cell.frames(exposure_ms, pose, view=view)
            self._taken = ((view, pose, exposure_ms), stack.frames)
        return self._taken[1]

    def move(self, view: str, camera_from_part: RigidTransform) -> RigidTransform:
        """Stand at a pose, and return the one that is reported."""
        with self._lock:
            self._at, self._pattern = (view, camera_from_part), 0
            self._frames(self._camera.exposure_ms)  # traces it, while nobody waits for a frame
        return self._cell.reported_pose(camera_from_part, view)

    def show(self, pattern: int) -> None:
        """Show a pattern of the sequence, from 0.

        Raises
        ------
        InputError
            If there is no such pattern.
        """
        if not 0 <= pattern < self._model.sequence.n_frames:
            msg = f"there are patterns 0 to {self._model.sequence.n_frames - 1}, got {pattern}"
            raise InputError(msg)
        with self._lock:
            self._pattern = pattern
            if self._at is not None:
                self._frames(self._camera.exposure_ms)

    def _answer(self, request: object) -> str:
        match request:
            case ["show", str(pattern)]:
                self.show(int(pattern))
                return ""
            case ["move", str(view), str(matrix)]:
                return printed_pose(self.move(view, requested_pose(matrix)))
        msg = "expected show PATTERN or move VIEW MATRIX"
        raise InputError(msg)

    def _write_files(self) -> None:
        folder, cell = self._folder, self._cell
        write_sensor(folder / "sensor.json", cell.sensor)
        write_features(folder / "features.csv", cell.part.features)
        text = sequence_to_toml(self._model.sequence)
        write_durably(folder / "sequence.toml", text.encode())
        write_durably(folder / CELL_FILE, tomli_w.dumps(self._cell_table()).encode())

    def _cell_table(self) -> dict[str, Any]:
        limits = self._model.limits
        return {
            "sensor": "sensor.json",
            "part": self._cell.part.name,
            "features": "features.csv",
            "camera": {"id": SERIAL, "timeout_s": _FRAME_S},
            "projector": self._requests.command("show", "{pattern}"),
            "sequence": {
                "name": "sequence.toml",
                "limits": {
                    "min_modulation": limits.min_modulation,
                    "max_residual": limits.max_residual,
                },
            },
            "move": self._requests.move_table,
        }

    @property
    def command(self) -> str:
        """How a plan is measured with the served cell."""
        return f"exposight measure PLAN --driver genicam --cell {shlex.quote(str(self.cell_file))}"

    @property
    def cell_file(self) -> Path:
        """The cell's file for a driver."""
        return self._folder / CELL_FILE

    def close(self) -> None:
        """End camera, projector and robot."""
        self._camera.close()
        self._requests.close()

    def __enter__(self) -> ServedCell:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _in_microseconds(exposure: ExposureRange) -> ExposureRange:
    """Return a range that a camera which counts whole µs has."""
    low, high = round(1000.0 * exposure.min_ms), round(1000.0 * exposure.max_ms)
    if abs(low - 1000.0 * exposure.min_ms) > 1e-6 or low < 1:
        msg = f"the served camera counts whole µs; the sensor's shortest is {exposure.min_ms:g} ms"
        raise SensorError(msg)
    return ExposureRange(min_ms=low / 1000.0, max_ms=high / 1000.0, increment_ms=0.001)

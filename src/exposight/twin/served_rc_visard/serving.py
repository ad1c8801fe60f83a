"""Both interfaces and the robot of a served cell, and the files with which a driver finds them."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import tomli_w

from exposight.cell import write_features, write_sensor
from exposight.errors import InputError
from exposight.files import write_durably
from exposight.rc_visard_messages import SERVICE, STREAM_NAME, grpc_library, message_class
from exposight.twin.request_server import (
    COMMAND_S,
    LOOPBACK,
    RequestServer,
    printed_pose,
    requested_pose,
)
from exposight.twin.served_rc_visard.device import CAMERA, Misbehaviour, ServedDevice
from exposight.twin.served_rc_visard.rest import RestServer
from exposight.twin.simulated_cell import SimulatedCell

CELL_FILE = "cell.toml"

_STREAMS = 8
"""Clients at the same time."""


class ServedRcVisard:
    """A simulated cell that answers on loopback as an rc_visard and a robot, until it is closed.

    Parameters
    ----------
    cell : SimulatedCell
        With a sensor of two rectified cameras.
    folder : path
        Gets the files that a driver needs: ``cell.toml``, and beside it sensor and features.
    misbehaviour : Misbehaviour, optional
        What the device does wrong.

    Attributes
    ----------
    device : ServedDevice
        Parameters and images.

    Raises
    ------
    SensorError
        If the sensor is another one, or gRPC is not installed.
    FileError
        If the folder cannot be written.
    """

    def __init__(
        self, cell: SimulatedCell, folder: str | Path, misbehaviour: Misbehaviour | None = None
    ) -> None:
        grpc = grpc_library()
        self._folder = Path(folder).resolve()
        self.device = ServedDevice(cell, misbehaviour or Misbehaviour())
        self._folder.mkdir(parents=True, exist_ok=True)
        self._images = grpc.server(ThreadPoolExecutor(_STREAMS), options=[("grpc.so_reuseport", 0)])
        stream = grpc.unary_stream_rpc_method_handler(
            self._stream,
            request_deserializer=message_class("ImageSetRequest").FromString,
            response_serializer=lambda message: message.SerializeToString(),
        )
        handler = grpc.method_handlers_generic_handler(SERVICE, {STREAM_NAME: stream})
        self._images.add_generic_rpc_handlers((handler,))
        self._image_port = self._images.add_insecure_port(f"{LOOPBACK}:0")
        self._images.start()
        self._rest = RestServer(self.device)
        self._requests = RequestServer(self._folder, self._answer)
        self._write_files()

    def _stream(self, _request: Any, context: Any) -> Iterator[Any]:
        """Yield image sets as long as somebody takes them."""
        wrong = self.device.misbehaviour
        for _ in range(wrong.stale_sets):
            if (stale := self.device.stale_set()) is not None:
                yield stale
        while context.is_active():
            if not wrong.silent:
                yield self.device.image_set()
            time.sleep(1.0 / self.device.value(CAMERA, "fps"))

    def _answer(self, request: object) -> str:
        match request:
            case ["move", str(view), str(matrix)]:
                return printed_pose(self.device.move(view, requested_pose(matrix)))
        msg = "expected move VIEW MATRIX"
        raise InputError(msg)

    def _write_files(self) -> None:
        folder, cell = self._folder, self.device.cell
        write_sensor(folder / "sensor.json", cell.sensor)
        write_features(folder / "features.csv", cell.part.features)
        table = {
            "sensor": "sensor.json",
            "part": cell.part.name,
            "features": "features.csv",
            "rc_visard": {
                "host": LOOPBACK,
                "port": self._rest.port,
                "image_port": self._image_port,
                "projector": "ExposureActive",
                "images_timeout_s": COMMAND_S,
            },
            "stereo": asdict(self.device.model.matching),
            "move": self._requests.move_table,
        }
        write_durably(folder / CELL_FILE, tomli_w.dumps(table).encode())

    @property
    def command(self) -> str:
        """How a plan is measured with the served cell."""
        return (
            f"exposight measure PLAN --driver rc_visard --cell {shlex.quote(str(self.cell_file))}"
        )

    @property
    def cell_file(self) -> Path:
        """The cell's file for a driver."""
        return self._folder / CELL_FILE

    def close(self) -> None:
        """End device and robot."""
        self._images.stop(None).wait()
        self._rest.close()
        self._requests.close()

    def __enter__(self) -> ServedRcVisard:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

"""Cameras that answer to Aravis, and control of one."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from exposight.aravis_library import aravis, aravis_error
from exposight.errors import SensorError

CONTROL_WAIT_S = 6.0
"""How long control of a camera is waited for: a holder that died loses it after its heartbeat
timeout, 3 s by default."""

_RETRY_S = 0.5


@dataclass(frozen=True, kw_only=True)
class FoundCamera:
    """A camera that answered.

    Parameters
    ----------
    id : str
        What Aravis calls it: vendor, model and serial number.
    serial : str
    address : str
        IP address, or the place on the USB bus.
    """

    id: str
    serial: str
    address: str

    def __str__(self) -> str:
        return f"{self.id} (serial {self.serial or 'unknown'}, {self.address or 'no address'})"


def cameras_found() -> tuple[FoundCamera, ...]:
    """Return the cameras that answer on the network and on USB; takes a second or so."""
    library = aravis()
    library.update_device_list()
    return tuple(
        FoundCamera(
            id=library.get_device_id(i) or "",
            serial=library.get_device_serial_nbr(i) or "",
            address=library.get_device_address(i) or "",
        )
        for i in range(library.get_n_devices())
    )


def open_camera(wanted: str, *, wait_s: float = CONTROL_WAIT_S) -> Any:
    """Open a camera and take control of it.

    Parameters
    ----------
    wanted : str
        Its id, serial number or address.
    wait_s : float, s
        How long control is waited for.

    Returns
    -------
    Aravis.Camera

    Raises
    ------
    SensorError
        If no such camera answers, several do, or another program holds it.
    """
    found = cameras_found()
    fitting = [each for each in found if wanted in (each.id, each.serial, each.address)]
    if len(fitting) != 1:
        there = "; ".join(map(str, found)) or "none"
        problem = "several cameras are" if fitting else "no camera is"
        msg = (
            f"{problem} called {wanted!r} by id, serial number or address; those that answer: "
            f"{there}. Check power, cable and that both are in one network"
        )
        raise SensorError(msg)
    return _controlled(fitting[0], time.monotonic() + wait_s)


def _controlled(found: FoundCamera, deadline: float) -> Any:
    reason = ""
    while True:
        try:
            camera = aravis().Camera.new(found.id)
            if is_controller(camera):
                return camera
            del camera  # asked for anew below
        except aravis_error() as error:
            reason = f" ({error})"
        if time.monotonic() > deadline:
            msg = (
                f"camera {found} is held by another program{reason}; close that, and run again. A "
                "program that died holds it for its heartbeat timeout, some seconds"
            )
            raise SensorError(msg)
        time.sleep(_RETRY_S)


def is_controller(camera: Any) -> bool:
    """Tell whether this process may set a camera; USB cameras are opened by one alone."""
    device = camera.get_device()
    return bool(device.is_controller()) if hasattr(device, "is_controller") else True

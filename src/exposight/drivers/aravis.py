"""Aravis, the library that speaks GigE Vision and USB3 Vision, as Debian packages it."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import sys
import time
from dataclasses import dataclass
from functools import cache
from typing import Any

from exposight.errors import SensorError

_SYSTEM_PACKAGES = "/usr/lib/python3/dist-packages"
"""Where Debian keeps Python's GObject interface, which a virtual environment does not see."""

_HOW_TO_INSTALL = (
    "cameras are reached through Aravis 0.8: on Debian and Ubuntu install the packages "
    "gir1.2-aravis-0.8 and python3-gi, elsewhere Aravis with its introspection data and PyGObject"
)

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


@cache
def aravis() -> Any:
    """Return Aravis's GObject interface.

    Raises
    ------
    SensorError
        If it is not installed; the message says what to install.
    """
    try:
        gi = sys.modules.get("gi") or _gi()
        gi.require_version("Aravis", "0.8")
        return importlib.import_module("gi.repository.Aravis")
    except (ImportError, ValueError) as error:
        msg = f"{_HOW_TO_INSTALL}; got: {error}"
        raise SensorError(msg) from error


@cache
def aravis_error() -> type[Exception]:
    """Return the exception that Aravis's calls raise."""
    aravis()
    return importlib.import_module("gi.repository.GLib").Error  # type: ignore[no-any-return]


def _gi() -> Any:
    """Import ``gi``, from the system's packages where this environment has none.

    Its folder does not come on the path: nothing else there belongs to this environment.
    """
    try:
        return importlib.import_module("gi")
    except ImportError:
        spec = importlib.machinery.PathFinder.find_spec("gi", [_SYSTEM_PACKAGES])
        if spec is None or spec.loader is None:
            raise
    module = importlib.util.module_from_spec(spec)
    sys.modules["gi"] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules["gi"]
        raise
    return module


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

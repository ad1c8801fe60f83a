"""What of an rc_visard is set, read back and restored: exposure time and output of the projector.

The device counts in seconds, the callers in ms. Its settings persist, so they are restored.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import Any

from exposight.cell import same_exposure
from exposight.drivers.rc_visard_rest import RcVisardSettings, RestApi
from exposight.errors import SensorError

logger = logging.getLogger(__name__)

_CAMERA_NODES = ("rc_camera", "rc_stereocamera")
"""Names of the camera's node, of newer firmware first."""

_MATCHING_NODE, _OUTPUT_NODE = "rc_stereomatching", "rc_iocontrol"

_MANUAL: Mapping[str, object] = {"exp_control": "Manual", "exp_auto": False}
"""What keeps the exposure time where it is set; older firmware has the second only."""

_DIGITS = 5
"""Of exposure times in ms: image sets hold them with 24 bits, which are 17.999999 ms otherwise."""


def milliseconds(seconds: float) -> float:
    """Return an exposure time of the device in ms."""
    return round(1000.0 * seconds, _DIGITS)


class RcVisard:
    """A device whose exposure time is set, until it is closed.

    Parameters
    ----------
    settings : RcVisardSettings

    Raises
    ------
    SensorError
        If it does not answer, or has no camera whose exposure time can be set.
    """

    def __init__(self, settings: RcVisardSettings) -> None:
        self.settings = settings
        self._api = RestApi(settings)
        self._restored: dict[str, dict[str, object]] = {}
        self.system: dict[str, Any] = _table(self._api.get("system"))
        self._camera = self._camera_node()
        self._parameters = self._read(self._camera)
        if "exp_value" not in self._parameters:
            msg = f"rc_visard at {settings.host}: its node {self._camera} has no exp_value"
            raise SensorError(msg)
        try:
            if settings.projector is not None:
                self._set(_OUTPUT_NODE, {"out1_mode": settings.projector})
        except BaseException:
            self.close()
            raise

    def description(self) -> dict[str, object]:
        """Return what decides its images and clouds, JSON-able."""
        matching = self._read(_MATCHING_NODE)
        gain = self._parameters.get("gain_value", {}).get("value")
        return {
            "serial": self.system.get("serial"),
            "gain_db": gain,
            "projector": self.settings.projector,
            "matching": {name: entry.get("value") for name, entry in sorted(matching.items())},
        }

    @property
    def limits_ms(self) -> tuple[float, float]:
        """Shortest and longest exposure time that it takes, ms.

        Raises
        ------
        SensorError
            If it does not tell.
        """
        entry = self._parameters["exp_value"]
        try:
            low, high = (milliseconds(float(entry[key])) for key in ("min", "max"))
        except (KeyError, TypeError, ValueError) as error:
            msg = f"rc_visard at {self.settings.host}: exp_value has no limits: {entry}"
            raise SensorError(msg) from error
        return low, high

    def time_s(self) -> float:
        """Return the device's clock, in which images have their timestamps.

        Raises
        ------
        SensorError
            If it has none.
        """
        return _number(_table(self._api.get("system")).get("time"), "time of the system")

    def set_exposure(self, exposure_ms: float, increment_ms: float) -> float:
        """Set an exposure time, and return the one that the device then has, ms.

        Parameters
        ----------
        exposure_ms : float, ms
        increment_ms : float, ms
            The sensor's, by which devices round (`same_exposure`).

        Raises
        ------
        SensorError
            If it cannot be taken, or the setting was ignored.
        """
        low, high = self.limits_ms
        clamped_ms = min(max(exposure_ms, low), high)
        host = self.settings.host
        if not same_exposure(exposure_ms, clamped_ms, increment_ms):
            msg = (
                f"rc_visard at {host} takes exposure times from {low:g} to {high:g} ms, "
                f"{exposure_ms:g} ms was asked for; plan inside its range"
            )
            raise SensorError(msg)
        control = next((name for name in _MANUAL if name in self._parameters), None)
        manual = {} if control is None else {control: _MANUAL[control]}
        wanted = {**manual, "exp_value": clamped_ms / 1000.0}
        self._parameters = self._set(self._camera, wanted)
        taken_ms = milliseconds(_number(self._parameters["exp_value"].get("value"), "exp_value"))
        if not same_exposure(exposure_ms, taken_ms, increment_ms):
            msg = (
                f"rc_visard at {host} ignored its setting: {exposure_ms:g} ms was asked for, "
                f"{taken_ms:g} ms read back; does another program set it?"
            )
            raise SensorError(msg)
        return taken_ms

    def close(self) -> None:
        """Restore what was changed; what cannot be restored is logged. May be called twice."""
        changed, self._restored = self._restored, {}
        for node, values in changed.items():
            try:
                self._api.put(self._path(node), _listed(values))
            except SensorError as error:
                logger.warning("settings were not restored, set %s by hand: %s", values, error)

    # -- nodes and parameters -------------------------------------------------------------------

    def _camera_node(self) -> str:
        listed = self._api.get(f"pipelines/{self.settings.pipeline}/nodes")
        names = {each.get("name") for each in listed if isinstance(each, dict)}
        for name in _CAMERA_NODES:
            if name in names:
                return name
        msg = (
            f"rc_visard at {self.settings.host}: pipeline {self.settings.pipeline} has no camera "
            f"({' or '.join(_CAMERA_NODES)}); check the pipeline"
        )
        raise SensorError(msg)

    def _path(self, node: str) -> str:
        return f"pipelines/{self.settings.pipeline}/nodes/{node}/parameters"

    def _read(self, node: str) -> dict[str, dict[str, Any]]:
        """Return a node's parameters by name, with their values and limits."""
        listed = self._api.get(self._path(node))
        entries = listed if isinstance(listed, list) else []
        return {each["name"]: each for each in entries if isinstance(each, dict) and "name" in each}

    def _set(self, node: str, values: Mapping[str, object]) -> dict[str, dict[str, Any]]:
        """Set parameters, and return all of the node as they then are."""
        before = self._parameters if node == self._camera else self._read(node)
        missing = [name for name in values if name not in before]
        if missing:
            msg = (
                f"rc_visard at {self.settings.host}: {node} has no {', '.join(missing)}: is a "
                "licence missing?"
            )
            raise SensorError(msg)
        known = self._restored.setdefault(node, {})
        for name in reversed(list(values)):  # the value before what may change it
            known.setdefault(name, before[name].get("value"))
        self._api.put(self._path(node), _listed(values))
        after = self._read(node)  # what the device has, not what it was sent
        for name, value in values.items():
            taken = after.get(name, {}).get("value")
            if not isinstance(value, float) and taken != value:
                msg = (
                    f"rc_visard at {self.settings.host} ignored its setting: {name} was set to "
                    f"{value!r}, {taken!r} read back"
                )
                raise SensorError(msg)
        return after


def _listed(values: Mapping[str, object]) -> list[dict[str, object]]:
    return [{"name": name, "value": value} for name, value in values.items()]


def _table(answer: Any) -> dict[str, Any]:
    return answer if isinstance(answer, dict) else {}


def _number(value: object, what: str) -> float:
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    msg = f"the rc_visard gave no number as {what}, got {value!r}"
    raise SensorError(msg)

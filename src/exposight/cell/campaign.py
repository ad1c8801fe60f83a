"""A campaign: all captures of one part by one sensor, in memory or on disk, one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

from exposight.cell.capture import Capture, CaptureKey
from exposight.cell.part import Part
from exposight.cell.sensor import ActiveSensor
from exposight.errors import InputError


class CaptureSource(Protocol):
    """All captures of one part by one sensor, in a fixed order, wherever they are kept."""

    @property
    def name(self) -> str:
        """What people call it."""
        ...

    @property
    def sensor(self) -> ActiveSensor:
        """The sensor that took every capture."""
        ...

    @property
    def part(self) -> Part:
        """The part that was measured."""
        ...

    def __len__(self) -> int:
        """Return the number of captures."""
        ...

    def captures(self) -> Iterator[Capture]:
        """Yield the captures one at a time, always in the same order."""
        ...


class MemoryCampaign:
    """A campaign whose captures are in memory.

    Parameters
    ----------
    name : str
        What people call it.
    sensor : ActiveSensor
        The sensor that took every capture.
    part : Part
        The part that was measured.
    captures : sequence of Capture
        At most one for each view and exposure time.

    Raises
    ------
    InputError
        If two captures have the same view and exposure time.
    ImageError, CloudError, SensorError
        If a capture cannot be this sensor's.
    """

    def __init__(
        self, *, name: str, sensor: ActiveSensor, part: Part, captures: Sequence[Capture]
    ) -> None:
        self.name = name
        self.sensor = sensor
        self.part = part
        keys: set[CaptureKey] = set()
        for capture in captures:
            capture.check_fits(sensor)
            check_new_key(capture.key, keys, name)
            keys.add(capture.key)
        self._captures = tuple(captures)

    def __len__(self) -> int:
        return len(self._captures)

    def captures(self) -> Iterator[Capture]:
        """Yield the captures in the order they were given."""
        yield from self._captures


def check_new_key(key: CaptureKey, known: set[CaptureKey], campaign: str) -> None:
    """Check that a campaign has no capture of this view and exposure time yet.

    Raises
    ------
    InputError
        If it has one.
    """
    if key in known:
        msg = (
            f"campaign {campaign!r} already has a capture of view {key.view!r} at "
            f"{key.exposure_ms:g} ms; give the view another name, or skip what is there"
        )
        raise InputError(msg)

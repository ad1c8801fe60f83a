"""What a sensor can be set to and what captures cost, as commands are told."""

from dataclasses import dataclass, replace
from typing import Annotated

from cyclopts import Group, Parameter
from cyclopts.types import PositiveInt
from cyclopts.validators import Number

from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.planning import CaptureCosts, ExposureLimits, limits_named


@Parameter("*", group=Group("The sensor's settings, and what captures take", sort_key=3))
@dataclass(frozen=True, kw_only=True)
class ExposureOptions:
    """Limits of exposure times, and the time that a capture takes.

    Parameters
    ----------
    limits
        Exposure times that the sensor can be set to: a profile's name, such as zivid-2, or a TOML
        file (docs/formats.md); as the models' sensor says by default.
    flicker
        Mains frequency of lamps nearby, Hz: exposure times are then multiples of half its period.
    most
        Take at most so many captures of a view.
    frames
        Images of a capture, each exposed for the exposure time.
    overhead
        What a capture takes beside its exposures, ms.
    """

    limits: Annotated[str | None, Parameter(metavar="PROFILE|FILE")] = None
    flicker: Annotated[float | None, Parameter(metavar="HZ", validator=Number(gt=0))] = None
    most: PositiveInt | None = None
    frames: PositiveInt = 1
    overhead: Annotated[float, Parameter(metavar="MS", validator=Number(gte=0))] = 0.0

    def exposure_limits(self, sensor: ActiveSensor | None) -> ExposureLimits:
        """Return the limits that hold.

        Parameters
        ----------
        sensor : ActiveSensor or None
            Whose limits hold where no others are given.

        Raises
        ------
        InputError
            If nobody says any, they leave no exposure time, or the sensor cannot take them.
        FileError
            If their file cannot be read.
        """
        if self.limits is not None:
            limits = limits_named(self.limits)
            if sensor is not None:
                limits.check_within(sensor)
        elif sensor is not None:
            limits = ExposureLimits.of(sensor)
        else:
            msg = "nobody says what the sensor can be set to: give --limits, a profile or a file"
            raise InputError(msg)
        if self.most is not None:
            least = min(limits.least_per_view, self.most)
            limits = replace(limits, least_per_view=least, most_per_view=self.most)
        return limits if self.flicker is None else limits.under_mains(self.flicker)

    def notes(self, limits: ExposureLimits, sensor: ActiveSensor | None) -> tuple[str, ...]:
        """Say where limits that are given are another sensor's by name."""
        if self.limits is None or sensor is None or limits.name == sensor.name:
            return ()
        return (f"limits are of {limits.name}, the models of {sensor.name}, which can take them",)

    @property
    def costs(self) -> CaptureCosts:
        """What captures take."""
        return CaptureCosts(frames=self.frames, overhead_ms=self.overhead)

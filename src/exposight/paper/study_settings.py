"""What decides the result of a study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from exposight.errors import InputError

SensorKind = Literal["structured-light", "stereo"]
"""The paper's two sensors: Zeiss COMET Pro AE, and rc_visard 65 with a dot projector (s2)."""

SENSOR_KINDS: tuple[SensorKind, ...] = ("structured-light", "stereo")
"""Both, in the paper's order."""


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """Everything that decides a study's result.

    Parameters
    ----------
    sensors : tuple of {'structured-light', 'stereo'}
        Which of the paper's sensors.
    quick : bool
        Measure a share of the views (`exposight.paper.campaigns`) and train from fewer starts.
    seed : int, 0 or more
        Seed of the splits and the restarts; simulated campaigns use the seeds of their plans.
    workers : int, 1 or more
        Number of parallel processes; does not change the result.
    campaigns : Path or None
        Folder of recorded campaigns (`exposight.paper.campaigns`); None simulates them.

    Raises
    ------
    InputError
        If a sensor is unknown or repeated, none is given, the seed is negative, or there is no
        worker.
    """

    sensors: tuple[SensorKind, ...] = SENSOR_KINDS
    quick: bool = False
    seed: int = 1
    workers: int = 2
    campaigns: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        unknown = [sensor for sensor in self.sensors if sensor not in SENSOR_KINDS]
        if unknown or not self.sensors or len(set(self.sensors)) < len(self.sensors):
            msg = (
                f"sensors must be one or both of {', '.join(SENSOR_KINDS)}, each once, got "
                f"{', '.join(map(repr, self.sensors)) or 'none'}"
            )
            raise InputError(msg)
        if self.seed < 0:
            msg = f"seed must be a whole number from 0 up, got {self.seed}"
            raise InputError(msg)
        if self.workers < 1:
            msg = f"a study needs at least 1 worker, got {self.workers}"
            raise InputError(msg)

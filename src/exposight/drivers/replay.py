"""A recorded campaign as a driver: it gives back its captures, and nothing else."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from exposight.cell import (
    ROUNDED_SHARE,
    ActiveSensor,
    CampaignFolder,
    Capture,
    Part,
    same_exposure,
)
from exposight.errors import InputError
from exposight.geometry import RigidTransform


class ReplayDriver:
    """Gives back the captures of a campaign by pose and exposure time (`exposight.cell.Driver`).

    Plans, closed loops and other drivers' users can thus be tried on recordings. A pose is found
    where it moves no feature by more than a tolerance; of several, the nearest one is taken, and of
    its exposure times again the nearest.

    Parameters
    ----------
    campaign : path
        The campaign's folder.
    tolerance_mm : float, mm
        How far a feature may lie, in the recorded pose, from where the pose asked for has it.
        Recorded poses carry the error of their alignment: up to 5 mm by the robot's kinematics
        (Sect. 3.2.2 of the paper), and the little that a turn adds.
    within : float
        How far the recorded exposure time may be from the one asked for, as a share of it; captures
        keep the recorded one.

    Raises
    ------
    FileError
        If the campaign or one of its descriptions cannot be read.
    InputError
        If it has no captures, or the share is not from 0 to 1.
    """

    concurrent = True

    def __init__(
        self, campaign: str | Path, *, tolerance_mm: float = 6.0, within: float = ROUNDED_SHARE
    ) -> None:
        if not 0.0 <= within <= 1.0:
            msg = f"a replay's exposure times may differ by a share from 0 to 1, got {within:g}"
            raise InputError(msg)
        self.exposure_share = within
        self._campaign = CampaignFolder(Path(campaign))
        self._tolerance_mm = tolerance_mm
        self._recorded = tuple(self._campaign.descriptions())
        if not self._recorded:
            msg = f"the campaign in {campaign} has no captures to give back"
            raise InputError(msg)

    @property
    def sensor(self) -> ActiveSensor:
        """The sensor that recorded the campaign."""
        return self._campaign.sensor

    @property
    def part(self) -> Part:
        """The part that was recorded."""
        return self._campaign.part

    def description(self) -> dict[str, object]:
        """Return what decides the captures, JSON-able."""
        facts: dict[str, object] = {
            "driver": "replay",
            "campaign": self._campaign.name,
            "tolerance_mm": self._tolerance_mm,
        }
        if self.exposure_share != ROUNDED_SHARE:  # campaigns of before have none
            facts["within"] = self.exposure_share
        return facts

    def capture(
        self, exposure_ms: float, camera_from_part: RigidTransform, *, view: str
    ) -> Capture:
        """Give back the capture that was recorded at a pose and exposure time.

        Parameters
        ----------
        exposure_ms : float, ms
            Met to the sensor's increment or the share, whichever is more (`same_exposure`).
        camera_from_part : RigidTransform
            Met to the tolerance. The capture keeps the recorded pose.
        view : str
            Name that the capture gets.

        Raises
        ------
        InputError
            If the campaign has no capture there; the message names the nearest one.
        """
        view_there = self.view_at(camera_from_part)
        number = self._number_of(view_there, exposure_ms)
        return replace(self._campaign.capture(number), view=view)

    def view_at(self, camera_from_part: RigidTransform) -> str:
        """Return the recorded view at a pose.

        Raises
        ------
        InputError
            If the campaign has no capture there; the message names the nearest view.
        """
        features_mm = np.array([f.part_from_feature.translation_mm for f in self.part.features])
        asked_mm = camera_from_part.apply(features_mm)
        away_mm = np.array(
            [
                np.linalg.norm(capture.camera_from_part.apply(features_mm) - asked_mm, axis=1).max()
                for capture in self._recorded
            ]
        )
        nearest = int(away_mm.argmin())
        recorded = self._recorded[nearest].view
        if away_mm[nearest] > self._tolerance_mm:
            msg = (
                f"campaign {self._campaign.name!r} has no capture at this pose: in the nearest "
                f"view, {recorded!r}, features lie up to {away_mm[nearest]:.1f} mm "
                f"elsewhere, and {self._tolerance_mm:g} mm are allowed; replay the poses that it "
                "recorded"
            )
            raise InputError(msg)
        return recorded

    def _number_of(self, view: str, exposure_ms: float) -> int:
        """Return the number of a recorded view's capture at the nearest exposure time."""
        numbers = {
            capture.exposure_ms: number
            for capture, number in zip(self._recorded, self._campaign.numbers, strict=True)
            if capture.view == view
        }
        best_ms = min(numbers, key=lambda ms: abs(ms - exposure_ms))
        increment_ms, share = self.sensor.exposure.increment_ms, self.exposure_share
        if not same_exposure(exposure_ms, best_ms, increment_ms, share):
            msg = (
                f"campaign {self._campaign.name!r} has view {view!r} at "
                f"{', '.join(f'{ms:g}' for ms in sorted(numbers))} ms, not at {exposure_ms:g} ms "
                f"or within {100 * share:g} % of it; replay the exposure times that it recorded: "
                "`exposight plan --limits FILE` plans with these alone where the file has them as "
                "`allowed_ms`; or allow more, `--within 10`"
            )
            raise InputError(msg)
        return numbers[best_ms]

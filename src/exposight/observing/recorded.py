"""A recorded campaign as scripts and notebooks use it: open, look, observe."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exposight.cell import PAPER_TOLERANCE, CampaignFolder, png_bytes
from exposight.observing.masks import View, view_features
from exposight.observing.observe import observe_campaign
from exposight.workers import Progress, ignore_progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    from exposight.cell import ActiveSensor, Capture, CaptureSource, Part, RingTolerance
    from exposight.geometry import RigidTransform
    from exposight.observing.table import ObservationTable

_PREVIEW_PX = 320
"""Width of the image that a notebook shows, at most."""


@dataclass(frozen=True, eq=False)
class Campaign:
    """All captures of one part by one sensor, and what can be asked of them.

    Parameters
    ----------
    source : CaptureSource
        Where the captures are: a folder on disk, or memory.
    """

    source: CaptureSource

    @property
    def name(self) -> str:
        """What people call it."""
        return self.source.name

    @property
    def sensor(self) -> ActiveSensor:
        """The sensor that took every capture."""
        return self.source.sensor

    @property
    def part(self) -> Part:
        """The part that was measured."""
        return self.source.part

    def __len__(self) -> int:
        return len(self.source)

    def captures(self) -> Iterator[Capture]:
        """Yield the captures one at a time, always in the same order."""
        return self.source.captures()

    def observe(
        self,
        *,
        tolerance: RingTolerance = PAPER_TOLERANCE,
        progress: Progress = ignore_progress,
    ) -> ObservationTable:
        """Observe every feature in every capture (`observe_campaign`)."""
        return observe_campaign(self.source, tolerance, progress)

    def view(self, camera_from_part: RigidTransform) -> View:
        """Return what the sensor sees of the part from a pose, measured or not.

        Parameters
        ----------
        camera_from_part : RigidTransform
            The pose of the part in the frame of the sensor's first camera.
        """
        features = view_features(self.part, self.sensor, camera_from_part)
        return View(camera_from_part=camera_from_part, features=features)

    def _repr_html_(self) -> str:
        facts = (
            f"<b>{html.escape(self.name)}</b>: {len(self)} captures of "
            f"{html.escape(self.part.name)} ({len(self.part.features)} features) by "
            f"{html.escape(self.sensor.name)}"
        )
        first = next(iter(self.captures()), None)
        if first is None:
            return f"<p>{facts}</p>"
        step = max(1, -(-first.image.shape[1] // _PREVIEW_PX))
        small = np.ascontiguousarray(first.grey_levels()[::step, ::step]).round().astype(np.uint8)
        data = base64.b64encode(png_bytes(small)).decode()
        shown = html.escape(str(first))
        return f'<p>{facts}</p><img alt="{shown}" src="data:image/png;base64,{data}"><p>{shown}</p>'


def open_campaign(path: str | Path) -> Campaign:
    """Open a campaign's folder.

    Parameters
    ----------
    path : path
        The folder, as the simulated cell or a measurement wrote it.

    Raises
    ------
    MissingFileError
        If the folder or one of its files is not there.
    DamagedFileError, FormatError, VersionError
        If it is no campaign, is damaged, or was written by a newer version of exposight.
    """
    return Campaign(CampaignFolder(Path(path)))

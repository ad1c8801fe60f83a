"""A capture that is sent to be observed, without a campaign folder."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, Field

from exposight import cell
from exposight.observing import observe_campaign
from exposight.service.bodies import POSE, PartAndSensor
from exposight.service.folder import ServedFolder
from exposight.service.guard import Limits
from exposight.service.uploads import (
    CaptureAbout,
    Upload,
    exposure_of,
    read_upload,
    upload_folder,
)


class ObserveQuestion(PartAndSensor, CaptureAbout):
    """What a capture shows of a part's features."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"campaign": "campaign", "camera_from_part": POSE, "exposure_ms": 12.5}]
        }
    )

    despite: list[str] = Field(
        default=[],
        max_length=100,
        description="Names of checks whose contradictions are accepted.",
    )

    def answer(self, upload: Upload, folder: ServedFolder, limits: Limits) -> dict[str, Any]:
        """Return the observations, a row for each feature."""
        part, sensor = self.part_and_sensor(folder, limits)
        with upload_folder() as place:
            capture = cell.Capture(
                view=self.view or "capture",
                exposure_ms=exposure_of(self),
                camera_from_part=self.pose(),
                **read_upload(upload, self, sensor, place, limits),
            )
            source = cell.MemoryCampaign(
                name="the upload", sensor=sensor, part=part, captures=[capture]
            )
            table = observe_campaign(source, despite=self.despite)
        return {
            "view": capture.view,
            "sensor": sensor.name,
            "part": part.name,
            "observations": table.frame.to_dicts(),
            "contradictions": [vars(each) for each in table.contradictions],
        }

"""Words and names that the study's page repeats."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from exposight.report.markup import escape
from exposight.report.quantities import column_name

if TYPE_CHECKING:
    from exposight.paper import SensorKind, StudyResult


SENSOR_TITLES: dict[SensorKind, str] = {
    "structured-light": "structured-light sensor",
    "stereo": "active stereo sensor",
}
_COLUMN = re.compile(r"\b(?:i_avg|p_norm)\b")


def prose(text: str) -> str:
    """Return a sentence that is kept as plain text, with the page's letters and apostrophes."""
    told = escape(text.replace("'", "’"))
    return _COLUMN.sub(lambda found: column_name(found.group()), told)


def measured_in(result: StudyResult) -> str:
    """Return where the observations come from, to be said with every figure."""
    if result.settings.campaigns is None:
        return "Measured in the simulated cell."
    return "Measured in the recorded campaigns."

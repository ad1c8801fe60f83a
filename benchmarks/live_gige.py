"""Frames over GigE Vision against the simulated cell's own, and a run that is unplugged.

Both need Aravis; where it is absent they are null.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from tests.drivers.serving import ServedProcess, frames_exact, small_plan, unplug_and_resume

from exposight.aravis_library import aravis
from exposight.errors import SensorError


def gige_figures() -> dict[str, bool | None]:
    """Return ``gige_frames_exact`` and ``gige_unplugged_resumed``; None where Aravis is absent."""
    try:
        aravis()
    except SensorError:
        return {"gige_frames_exact": None, "gige_unplugged_resumed": None}
    return {
        "gige_frames_exact": gige_frames_exact(),
        "gige_unplugged_resumed": gige_unplugged_resumed(),
    }


def gige_frames_exact() -> bool:
    """Tell whether a view's frames are the simulated cell's at five exposure times."""
    with (
        tempfile.TemporaryDirectory() as folder,
        ServedProcess(Path(folder), small_plan()) as served,
    ):
        return frames_exact(served)


def gige_unplugged_resumed() -> bool:
    """Tell whether a run whose devices are killed goes on with nothing lost."""
    with (
        tempfile.TemporaryDirectory() as folder,
        ServedProcess(Path(folder), small_plan((17.0, 150.0))) as served,
    ):
        try:
            unplug_and_resume(served, Path(folder) / "campaign")
        except AssertionError:
            return False
    return True


if __name__ == "__main__":
    print(json.dumps(gige_figures()))

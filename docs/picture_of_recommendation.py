"""The demonstration's recommendation for a view that nobody took, and what came of it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from picture_style import PICTURES

from exposight.report import DemonstrationSettings, run_demonstration


def draw_recommendation(folder: Path | None = None) -> None:
    """Run the demonstration, in a folder that is kept or in none, and save its picture."""
    with tempfile.TemporaryDirectory() as unkept:
        report = run_demonstration(folder or unkept, DemonstrationSettings())
        picture = report.content["promise_figure"]
    (PICTURES / "recommendation.png").write_bytes(picture.png)

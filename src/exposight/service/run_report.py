"""The page about a run's campaign, made in a process of its own, which is ended after a time."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from exposight.cell import CampaignFolder
from exposight.errors import ExposightError, MissingFileError
from exposight.files import KeptFiles, make_folder
from exposight.leash import leashed
from exposight.measuring.view_work import campaign_rows
from exposight.models import load_model
from exposight.observing import ObservationTable, parse_observations
from exposight.report import campaign_report
from exposight.service.faults import RequestError
from exposight.service.folder import ServedFolder
from exposight.service.run_files import RunFolder

_PAGE = "report.html"


def report_page(run: RunFolder, served: ServedFolder, limit_s: float) -> bytes:
    """Return the page about a run's campaign as far as it has grown; HTML.

    Parameters
    ----------
    run : RunFolder
    served : ServedFolder
        That has the models.
    limit_s : float, s
        Longer it may not take.

    Raises
    ------
    RequestError
        409 if it cannot be made yet, or takes longer.
    """
    if not (run.campaign / "campaign.json").is_file():
        msg = f"there is no report of run {run.name!r} yet: nothing was captured"
        raise RequestError(409, msg)
    request, numbers = run.request, served.campaign(served.name_of(run.campaign)).numbers
    models = [] if request.models is None else served.model_files(request.models)
    about = [f"{path} {_changed(path)}" for path in models]
    kept = KeptFiles(make_folder(run.path / "report"), *about, *map(str, numbers))
    if path := kept.find(_PAGE):
        return path.read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / _PAGE
        _make(run, served.root, models, page, limit_s)
        data = page.read_bytes()
    for older in (run.path / "report").glob("report-*"):
        older.unlink(missing_ok=True)
    kept.keep(_PAGE, data)
    return data


def _changed(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        msg = f"the model {path.name} is not there any more"
        raise MissingFileError(msg) from error


def _make(run: RunFolder, root: Path, models: list[Path], page: Path, limit_s: float) -> None:
    try:
        made = subprocess.run(
            leashed(__file__, str(run.path), str(page), str(root), *map(str, models)),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=limit_s,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        msg = (
            f"the report of run {run.name!r} takes longer than {limit_s:g} s; make it with "
            "`exposight report`"
        )
        raise RequestError(409, msg) from error
    if made.returncode != 0:
        reason = made.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        msg = f"there is no report of run {run.name!r} yet: {reason or 'its process was killed'}"
        raise RequestError(409, msg)


def main(run: str, page: str, root: str, *models: str) -> None:
    """Write the page about a run's campaign; why there is none is the last line of the errors."""
    folder = RunFolder(Path(run))
    served = ServedFolder(Path(root))
    campaign = served.campaign(served.name_of(folder.campaign))
    source: CampaignFolder | ObservationTable = campaign
    if not folder.request.clouds:
        source = parse_observations(campaign_rows(campaign), f"observations of run {folder.name}")
    loaded = [load_model(Path(path)) for path in models]
    report = campaign_report(source, loaded, title=folder.name)
    Path(page).write_bytes(report.html().encode())


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except ExposightError as reason:
        sys.exit(" ".join(str(reason).split()))

"""A comparison's results: one JSON file that others can add theirs to, and its scores as CSV."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exposight.errors import FormatError, InputError
from exposight.files import DocumentFormat, csv_of, make_folder, read_text, write_durably
from exposight.planning.comparing.comparison import Comparison
from exposight.planning.comparing.view_outcomes import ViewOutcome

RESULTS = "results.json"
SCORES = "results.csv"


@dataclass(frozen=True, kw_only=True)
class _Results:
    """The JSON document; scores follow from outcomes and are there to be read."""

    sweep: str
    sweep_sha256: str
    about: dict[str, Any]
    scores: tuple[dict[str, Any], ...]
    outcomes: tuple[ViewOutcome, ...]


_FORMAT = DocumentFormat("exposight comparison", 1, _Results)


def write_comparison(comparison: Comparison, folder: str | Path) -> None:
    """Write ``results.json`` and ``results.csv`` (``docs/benchmark.md``) into a folder.

    Raises
    ------
    FileError
        If they cannot be written.
    """
    folder = make_folder(Path(folder), "the results")
    scores = comparison.scores
    results = _Results(
        sweep=comparison.sweep,
        sweep_sha256=comparison.sweep_sha256,
        about=dict(comparison.about),
        scores=tuple(scores.fill_nan(None).to_dicts()),
        outcomes=comparison.outcomes,
    )
    write_durably(folder / RESULTS, _FORMAT.to_json(results).encode())
    write_durably(folder / SCORES, csv_of(scores))


def read_comparison(path: str | Path) -> Comparison:
    """Read a ``results.json``, or the one in a folder.

    Raises
    ------
    MissingFileError
        If it is not there.
    FormatError, VersionError
        If it is no such file.
    """
    path = Path(path)
    path = path / RESULTS if path.is_dir() else path
    results = _FORMAT.from_json(read_text(path, "file of results"), str(path))
    try:
        return Comparison(
            outcomes=results.outcomes,
            sweep=results.sweep,
            sweep_sha256=results.sweep_sha256,
            about=results.about,
        )
    except InputError as error:
        msg = f"{path}: {error}"
        raise FormatError(msg) from error

"""Observations of finished views, kept beside the table that they will make until it is written."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from exposight.cell import preset_name, write_sensor
from exposight.errors import FileError, FormatError, MissingFileError
from exposight.files import KeptFiles, hold_writer_lock, sweep_unfinished
from exposight.measuring.record import keep_record
from exposight.observing import ObservationTable, read_observations

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from exposight.plans import MeasuringPlan


_VIEWS = "[0-9]*.csv"


def views_folder(table: Path) -> Path:
    """Return the folder in which a table's finished views lie while it is not written."""
    return table.with_name(f"{table.name}.views")


def check_table_path(table: Path) -> None:
    """Find out before hours of work that a table cannot be written.

    Raises
    ------
    FormatError
        If its suffix is neither .csv nor .parquet.
    MissingFileError
        If its folder is not there.
    """
    if table.suffix.lower() not in {".csv", ".parquet"}:
        msg = f"{table}: an observation table ends in .csv or .parquet, got '{table.suffix}'"
        raise FormatError(msg)
    if not table.parent.is_dir():
        msg = f"{table}: the folder {table.parent} does not exist; make it first"
        raise MissingFileError(msg)


class KeptViews:
    """The finished views of a table, on disk; `open_beside` makes one.

    Parameters
    ----------
    folder : Path
        Where they lie.
    record_sha256 : str
        Checksum of the record of what is measured.
    """

    def __init__(self, folder: Path, record_sha256: str) -> None:
        self._folder = folder
        self._files = KeptFiles(folder, record_sha256)

    @classmethod
    @contextmanager
    def open_beside(
        cls, table: Path, *, plan: MeasuringPlan, description: dict[str, Any]
    ) -> Iterator[KeptViews]:
        """Open or make the folder beside a table, for one process at a time.

        Raises
        ------
        InputError
            If it holds views of another plan or driver.
        FileError
            If another process has it open, a file in it is damaged, or the disk refuses.
        """
        folder = views_folder(table)
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            msg = f"the folder {folder} for finished views cannot be made: {error.strerror}"
            raise FileError(msg) from error
        lock = hold_writer_lock(folder, "the unfinished table")
        try:
            sweep_unfinished(folder)
            if preset_name(plan.sensor) is None:  # else the plan names it
                write_sensor(folder / "sensor.json", plan.sensor)
            record_sha256 = keep_record(
                folder,
                plan=plan,
                description=description,
                clouds=False,
                n_captures=len(list(folder.glob(_VIEWS))),
                what="unfinished table",
            )
            yield cls(folder, record_sha256)
        finally:
            if folder.exists() and not list(folder.glob(_VIEWS)):  # nothing to go on with
                shutil.rmtree(folder, ignore_errors=True)
            lock.release()

    def find(self, number: int) -> ObservationTable | None:
        """Return the observations of a view, or None where it is unfinished or was damaged."""
        path = self._files.find(f"{number:06d}.csv")
        return None if path is None else read_observations(path)

    def keep(self, number: int, table: ObservationTable) -> None:
        """Keep the observations of a finished view.

        Raises
        ------
        FileError
            If the disk is full or refuses. What was kept before stays.
        """
        self._files.keep(f"{number:06d}.csv", table.frame.write_csv().encode())

    def remove(self) -> None:
        """Remove all of it: the table is written."""
        shutil.rmtree(self._folder, ignore_errors=True)

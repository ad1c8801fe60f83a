"""What commands return, and its two forms: tables on a terminal, one JSON object for machines."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rich import box
from rich.cells import cell_len
from rich.measure import Measurement
from rich.table import Table as Grid
from rich.text import Text

from exposight.cli.terminal import console
from exposight.contradictions import Contradiction
from exposight.errors import FileError
from exposight.quantities import QUANTITIES
from exposight.tables import Column, Table, count

_MOST_REMARKS = 12
"""Lines about what was recognised in files."""


@dataclass(frozen=True, kw_only=True)
class Fact:
    """One thing that a command found out.

    Parameters
    ----------
    name : str
        Key in JSON; people read it with blanks for underscores.
    value : object
        For machines.
    text : str
        For people; empty where it is for machines only.
    """

    name: str
    value: object
    text: str


def fact(name: str, value: object, text: str | None = None) -> Fact:
    """Return a fact whose text, if not given, is its value."""
    shown = Column(name=name).cell({name: value}) if text is None else text
    return Fact(name=name, value=value, text=shown)


@dataclass(frozen=True, kw_only=True)
class Written:
    """A file or folder that a command wrote; make it before writing, to know what was there."""

    kind: str
    path: Path
    replaced: bool

    @classmethod
    def at(cls, path: Path, kind: str, *, inputs: Iterable[Path | None] = ()) -> Written:
        """Check that a file may be written, and note whether another one has that name.

        Parameters
        ----------
        path : Path
            The file.
        kind : str
            What it will hold.
        inputs : iterable of Path or None
            Files that the command reads.

        Raises
        ------
        FileError
            If it is one of the inputs.
        """
        for read in inputs:
            if read is not None and path.exists() and read.exists() and path.samefile(read):
                msg = f"{path} is read by this command and would be replaced; give another --output"
                raise FileError(msg)
        return cls(kind=kind, path=path, replaced=path.is_file())


@dataclass(frozen=True, kw_only=True)
class Result:
    """What a command found out and did.

    Parameters
    ----------
    title : str
        Heading, for people.
    facts : tuple of Fact
        Keys and values of the JSON object; lines on a terminal.
    tables : tuple of Table
        Each one is a list of objects in JSON, under its name.
    recognised : tuple of str
        What readers recognised in foreign files: separators, units, calibrations' names.
    notes : tuple of str
        Remarks that the reader should not miss.
    contradictions : tuple of Contradiction
        Inputs that say the same thing twice and do not agree, where the result may still be right.
    files : tuple of Written
        What was written.
    next_step : str
        A command that may follow, for people.
    failed : bool
        Whether something of what was asked for could not be done: the exit status is 1.
    """

    title: str = ""
    facts: tuple[Fact, ...] = ()
    tables: tuple[Table, ...] = ()
    recognised: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    contradictions: tuple[Contradiction, ...] = ()
    files: tuple[Written, ...] = ()
    next_step: str = ""
    failed: bool = False

    def document(self) -> dict[str, object]:
        """Return the result as a JSON object."""
        return {
            **{fact.name: fact.value for fact in self.facts},
            **{table.name: table.frame.to_dicts() for table in self.tables},
            **({"recognised": self.recognised} if self.recognised else {}),
            "notes": self.notes,
            "contradictions": self.contradictions,
            "files": self.files,
        }

    def show(self) -> None:
        """Print the result for people."""
        if self.title:
            _print_line(self.title, style="bold")
        if shown := [fact for fact in self.facts if fact.text]:
            _print_facts(shown)
        tables = [table for table in self.tables if table.shown_rows != 0]
        for position, table in enumerate(tables):
            if self.title or shown or position:
                _print_line("")
            _print_table(table)
        for remark in self.recognised[:_MOST_REMARKS]:
            console().print(Text.assemble(("read: ", "bold cyan"), remark))
        if left := len(self.recognised[_MOST_REMARKS:]):
            _print_line(f"read: {count(left)} more remarks, with --json all")
        for contradiction in self.contradictions:
            marked = Text.assemble(("contradiction: ", "bold red"), str(contradiction))
            console().print(marked)
        for note in self.notes:
            console().print(Text.assemble(("note: ", "bold yellow"), note))
        for file in self.files:
            _print_line(f"{'replaced' if file.replaced else 'wrote'} the {file.kind}: {file.path}")
        if self.next_step:
            _print_line(f"next: exposight {self.next_step}")


def _print_line(text: str, *, style: str = "") -> None:
    """Print a line that is never broken: paths in it stay whole."""
    console().print(Text(text, style=style), soft_wrap=True)


def _print_facts(facts: Iterable[Fact]) -> None:
    grid = Grid.grid(padding=(0, 2))
    grid.add_column(style="cyan", no_wrap=True)
    grid.add_column(overflow="fold")
    for fact in facts:
        name = fact.name if fact.name in QUANTITIES else fact.name.replace("_", " ")
        grid.add_row(f"  {name}", Text(fact.text))
    console().print(grid)


_WIDEST = 10_000
"""Columns of a terminal wider than any table."""


def _print_table(table: Table) -> None:
    if table.title:
        _print_line(table.title, style="bold")
    grid = Grid(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    cells = table.cells()
    shown_cells = cells[: table.shown_rows]
    for place, column in enumerate(table.columns):
        lines = [*column.heading.splitlines(), *(row[place] for row in shown_cells)]
        grid.add_column(
            column.heading,
            min_width=None if column.wraps else max(map(cell_len, lines), default=None),
            justify="left" if table.is_text(column) else "right",
            overflow="fold",
            no_wrap=not column.wraps,
            header_style="cyan",
        )
    for row in shown_cells:
        grid.add_row(*map(Text, row))
    shown = console()
    # A line too long for the terminal is broken by it; a column cut short would be another number.
    needed = Measurement.get(shown, shown.options.update(width=_WIDEST), grid).minimum
    shown.print(grid, width=max(shown.width, needed), crop=False)
    if left := len(cells[table.shown_rows :]) if table.shown_rows else 0:
        _print_line(f"  … {count(left)} more; --output writes them all")

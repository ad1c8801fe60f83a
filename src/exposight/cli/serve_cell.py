"""``exposight simulate --serve-as``: the simulated cell's devices, until the program is ended."""

import threading
from contextlib import suppress
from pathlib import Path

from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.twin import ServedCell, SimulatedCell

_FOR_EVER = threading.Event()


def serve_cell(cell: SimulatedCell, folder: Path) -> Result:
    """Serve a cell's camera, projector and robot on loopback until Ctrl-C or SIGTERM.

    Parameters
    ----------
    cell : SimulatedCell
    folder : Path
        Gets the cell's file and what it names.
    """
    with ServedCell(cell, folder) as served:
        with progress_bars() as progress:
            progress.line(f"serving the cell on loopback until Ctrl-C; {served.command}")
        with suppress(KeyboardInterrupt):  # the way to end it
            _FOR_EVER.wait()
        path = served.cell_file
    return Result(
        title=f"served part {cell.part.name}, {cell.sensor.name}",
        facts=(fact("part", cell.part.name), fact("sensor", cell.sensor.name)),
        files=(Written(kind="cell", path=path, replaced=False),),
    )

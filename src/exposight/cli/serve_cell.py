"""``exposight simulate --serve-as``: the simulated cell's devices, until the program is ended."""

import threading
from contextlib import suppress
from pathlib import Path
from typing import Literal

from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.twin import ServedCell, ServedRcVisard, SimulatedCell

_FOR_EVER = threading.Event()

ServedAs = Literal["gige-vision", "rc-visard"]
"""What a simulated cell can be served as."""


def serve_cell(cell: SimulatedCell, folder: Path, served_as: ServedAs) -> Result:
    """Serve a cell's sensor, projector and robot on loopback until Ctrl-C or SIGTERM.

    Parameters
    ----------
    cell : SimulatedCell
    folder : Path
        Gets the cell's file and what it names.
    served_as : {"gige-vision", "rc-visard"}
        What drivers find.
    """
    served_class = ServedCell if served_as == "gige-vision" else ServedRcVisard
    with served_class(cell, folder) as served:
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

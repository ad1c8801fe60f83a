"""The command line: every stage of the method, for people and, with ``--json``, for machines."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from exposight.cli.interrupts import ended_by_interrupts, interrupts_raised


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command and options; those that the program was called with by default.

    Returns
    -------
    int
        Exit status.
    """
    with ended_by_interrupts():  # from the first import on
        from exposight.cli.app import run
    with interrupts_raised():
        return run(sys.argv[1:] if arguments is None else arguments)

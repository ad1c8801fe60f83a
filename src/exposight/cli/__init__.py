"""The command line: every stage of the method, for people and, with ``--json``, for machines."""

from exposight.cli.interrupts import ended_by_interrupts


def main() -> None:
    """Run the program with the command line's arguments, and exit."""
    with ended_by_interrupts():  # from the first import on
        from exposight.cli.app import run
    run()

"""The command line: every stage of the method, for people and, with ``--json``, for machines."""

from exposight.cli.app import app, main

__all__ = ["app", "main"]

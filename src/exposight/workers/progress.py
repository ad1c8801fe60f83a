"""Progress reports: one contract for everything that takes more than two seconds."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives the progress of a piece of work; a terminal draws a bar."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Report progress.

        Parameters
        ----------
        stage : str
            What is being done, such as "observing".
        done, total : int
            Steps done and steps in all; a total of 0 means that it is not known yet.
        """
        ...


def ignore_progress(stage: str, done: int, total: int) -> None:
    """Ignore progress."""

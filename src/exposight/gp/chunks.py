"""Rows worked on a chunk at a time, telling how far the work is."""

from collections.abc import Callable

from exposight.gp.threads import choose_threads, in_threads, limit_blas
from exposight.workers import Progress


def in_chunks(
    work: Callable[[slice], None],
    rows: int,
    *,
    chunk: int,
    threads: int | None,
    worthwhile: bool,
    stage: str,
    progress: Progress,
) -> None:
    """Work on rows a chunk at a time, in threads where that is worth it.

    Parameters
    ----------
    work : callable
        Called with the rows of one chunk; its linear algebra runs on one thread.
    rows : int
        How many there are.
    chunk : int
        Rows at once.
    threads, worthwhile
        As for `choose_threads`.
    stage, progress : str, Progress
        Called with the stage, rows done, and all rows.

    Raises
    ------
    InputError
        If fewer than one thread is asked for.
    """
    chunks = [slice(start, min(start + chunk, rows)) for start in range(0, rows, chunk)]
    count = choose_threads(threads, worthwhile=worthwhile)
    with limit_blas(1):
        for own, _ in zip(chunks, in_threads(work, chunks, threads=count), strict=True):
            progress(stage, own.stop, rows)


def part_of(progress: Progress, stage: str, *, before: int, total: int) -> Progress:
    """Make a part of some work report its steps as steps of the whole.

    Parameters
    ----------
    progress : Progress
        Of the whole.
    stage : str
        Of the whole.
    before : int
        Steps done when the part begins.
    total : int
        Steps of the whole.

    Returns
    -------
    Progress
        For the part.
    """
    return lambda _, done, __: progress(stage, before + done, total)

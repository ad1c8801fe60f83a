"""Rows worked on a chunk at a time, telling how far the work is."""

from collections.abc import Callable

from exposight.gp.threads import choose_threads, in_threads, limit_blas


def in_chunks(
    work: Callable[[slice], None],
    rows: int,
    *,
    chunk: int,
    threads: int | None,
    worthwhile: bool,
    progress: Callable[[int, int], None] | None,
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
    progress : callable, optional
        Called with (rows done, all rows).

    Raises
    ------
    InputError
        If fewer than one thread is asked for.
    """
    chunks = [slice(start, min(start + chunk, rows)) for start in range(0, rows, chunk)]
    count = choose_threads(threads, worthwhile=worthwhile)
    with limit_blas(1):
        for own, _ in zip(chunks, in_threads(work, chunks, threads=count), strict=True):
            if progress is not None:
                progress(own.stop, rows)


def part_of(
    progress: Callable[[int, int], None] | None, *, before: int, total: int
) -> Callable[[int, int], None] | None:
    """Make a part of some work report its steps as steps of the whole.

    Parameters
    ----------
    progress : callable or None
        Of the whole, called with (steps done, all steps).
    before : int
        Steps done when the part begins.
    total : int
        Steps of the whole.

    Returns
    -------
    callable or None
        For the part; None where nobody asks for progress.
    """
    return None if progress is None else lambda done, _: progress(before + done, total)

"""Computes answers beside the server's loop: so many at once, so many waiting, and no longer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from exposight.service.faults import RequestError
from exposight.service.guard import Limits

_Arguments = ParamSpec("_Arguments")
_Answer = TypeVar("_Answer")


class Computing:
    """A few threads that compute answers.

    A thread cannot be ended from outside. An answer that takes too long is given up, and its thread
    is free again when it is through; until then one fewer answers.

    Parameters
    ----------
    limits : Limits
        `busy` threads, up to `waiting` requests for them, each up to `request_s`.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._pool = ThreadPoolExecutor(limits.busy, thread_name_prefix="answer")
        self._pending = 0

    async def run(
        self,
        compute: Callable[_Arguments, _Answer],
        *args: _Arguments.args,
        **kwargs: _Arguments.kwargs,
    ) -> _Answer:
        """Return what a function returns.

        Raises
        ------
        RequestError
            429 where too many wait already, 408 where it takes too long.
        """
        if self._pending >= self._limits.busy + self._limits.waiting:
            msg = f"{self._pending} requests are being answered already; ask again a little later"
            raise RequestError(429, msg)
        loop = asyncio.get_running_loop()
        self._pending += 1
        future = self._pool.submit(compute, *args, **kwargs)
        future.add_done_callback(lambda _: loop.call_soon_threadsafe(self._done))
        try:
            async with asyncio.timeout(self._limits.request_s):
                return await asyncio.wrap_future(future)
        except TimeoutError as error:
            if not _given_up(future):
                raise
            msg = (
                f"there was no answer within {self._limits.request_s:g} s; ask for less at once, "
                "or give the server more time (--max-seconds)"
            )
            raise RequestError(408, msg) from error

    def _done(self) -> None:
        self._pending -= 1

    def close(self) -> None:
        """Begin nothing more."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _given_up(future: Future[_Answer]) -> bool:
    """Tell whether a computation was given up, rather than having raised a `TimeoutError`."""
    return future.cancelled() or not future.done()

"""Solve programs by HiGHS (through scipy) in another process, which Ctrl-C or a time limit can end.

scipy's solver ignores Ctrl-C until it is done. The other process runs this file as a script, which
imports numpy and scipy only: neither a fork, which hangs after compiled threads, nor the ``if
__name__ == "__main__"`` that multiprocessing asks of every script. Programs and answers travel as
NumPy archives with their length before them; nothing is pickled.
"""

from __future__ import annotations

import io
import math
import os
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import IO, Any

import numpy as np
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, linprog, milp

_INFEASIBLE = 2  # scipy's status: "the problem is infeasible"


def solve_arrays(request: Mapping[str, Any]) -> dict[str, Any]:
    """Solve one program.

    Parameters
    ----------
    request : mapping
        ``objective``, ``low``, ``upper``, ``whole``, the matrix as ``data``, ``indices`` and
        ``indptr``; ``relaxed`` (whether numbers need not be whole), ``limit_s``, and ``gap``, the
        share of the objective at which to stop.

    Returns
    -------
    dict
        ``bound``: no solution costs less (−inf if that is not known, inf if there is none);
        ``x``: the best solution, empty if none was found; ``finished``: whether time sufficed;
        ``reduced``: reduced costs at 0, and ``price``: what the objective changes by if the last
        row's bound is lowered by 1, of a relaxed program.
    """
    shape = (len(request["low"]), len(request["objective"]))
    matrix = sparse.csr_array((request["data"], request["indices"], request["indptr"]), shape=shape)
    c, low, upper = request["objective"], request["low"], request["upper"]
    limit = max(float(request["limit_s"]), 0.05)
    if request["relaxed"]:
        answer = linprog(
            c,
            A_ub=-matrix,
            b_ub=-low,
            bounds=np.column_stack([np.zeros(len(c)), upper]),
            method="highs-ipm",  # half the time of the simplex method on these programs
            options={"time_limit": limit},
        )
        if answer.status != 0:
            return _without_solution(answer.status)
        reduced = np.maximum(answer.lower.marginals, 0.0)
        return {
            "bound": float(answer.fun),
            "x": answer.x,
            "finished": True,
            "reduced": reduced,
            "price": float(answer.ineqlin.marginals[-1]),
        }
    answer = milp(
        c,
        constraints=LinearConstraint(matrix, low, np.inf),
        integrality=request["whole"],
        bounds=Bounds(np.zeros(len(c)), upper),
        options={"time_limit": limit, "mip_rel_gap": float(request["gap"])},
    )
    bound = getattr(answer, "mip_dual_bound", None)
    if answer.x is None:
        return _without_solution(answer.status, bound)
    return {
        "bound": -math.inf if bound is None else float(bound),
        "x": answer.x,
        "finished": answer.status == 0,
        "reduced": np.zeros(0),
    }


def _without_solution(status: int, bound: float | None = None) -> dict[str, Any]:
    """Return the answer where there is no solution, or none was found in time."""
    none = np.zeros(0)
    known = math.inf if status == _INFEASIBLE else -math.inf if bound is None else float(bound)
    return {"bound": known, "x": none, "finished": status == _INFEASIBLE, "reduced": none}


class HighsProcess:
    """Another process that solves programs one after the other, until it is closed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = ThreadPoolExecutor(max_workers=1)

    def start(self, request: Mapping[str, Any]) -> Future[dict[str, Any]]:
        """Begin to solve a program after those before it; see `solve_arrays`."""
        if self._process is None:
            from exposight.leash import leashed  # not above: the script needs nothing of exposight

            # In a session of its own, as Ctrl-C is for the process that waits.
            self._process = subprocess.Popen(
                leashed(__file__),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        return self._thread.submit(_exchange, self._process, request)

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
        self._thread.shutdown(wait=True)
        if self._process is not None:
            for stream in (self._process.stdin, self._process.stdout):
                with suppress(BrokenPipeError):
                    if stream is not None:
                        stream.close()
            self._process.wait()


def _exchange(process: subprocess.Popen[bytes], request: Mapping[str, Any]) -> dict[str, Any]:
    assert process.stdin is not None
    assert process.stdout is not None
    _write(process.stdin, request)
    answer = _read(process.stdout)
    if answer is None:
        msg = "the solver's process ended without an answer"
        raise ChildProcessError(msg)
    return {**answer, "bound": float(answer["bound"]), "finished": bool(answer["finished"])}


def _write(stream: IO[bytes], arrays: Mapping[str, Any]) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    stream.write(len(buffer.getbuffer()).to_bytes(8, "little"))
    stream.write(buffer.getbuffer())
    stream.flush()


def _read(stream: IO[bytes]) -> dict[str, Any] | None:
    size = stream.read(8)
    data = stream.read(int.from_bytes(size, "little")) if len(size) == 8 else b""
    if not data:
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return dict(archive)


def _serve() -> None:
    """Answer requests until there are no more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the solver prints is no answer
    while (request := _read(sys.stdin.buffer)) is not None:
        _write(answers, solve_arrays(request))


if __name__ == "__main__":
    _serve()

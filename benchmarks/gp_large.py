"""One evaluation of 13 466 observations, in a process of its own: CPU seconds and peak memory.

Run by ``make bench NAME=gp``. Prints one JSON object.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np

from benchmarks.gp_peers import inputs, quality_kernel
from exposight.gp.likelihood import MarginalLikelihood

ROWS = 13_466  # the stereo sensor's dataset, Table 9


def main() -> None:
    """Evaluate likelihood and gradient once, compiled before."""
    rng = np.random.default_rng(1)
    x = inputs(rng, ROWS, 4)
    y = np.sin(x[:, 0] / 60.0) + 0.05 * rng.standard_normal(ROWS)
    kernel = quality_kernel()

    def evaluate(rows: int) -> float:
        active = np.ones(rows, dtype=np.bool_)
        likelihood = MarginalLikelihood(x[:rows], y[:rows], active=active, threads=1)
        began = time.process_time()
        likelihood.value_and_gradient(kernel, 0.003)
        return time.process_time() - began

    evaluate(50)
    cpu_s = evaluate(ROWS)
    print(json.dumps({"cpu_s": cpu_s, "peak_gb": _peak_gb()}))


def _peak_gb() -> float | None:
    """Peak of this process's resident memory; None where there is no ``/proc``.

    The operating system's own account (``getrusage``) would hold the starting process's peak too.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    (peak,) = [line for line in status.read_text().splitlines() if line.startswith("VmHWM")]
    return int(peak.split()[1]) * 1024 / 1e9


if __name__ == "__main__":
    main()

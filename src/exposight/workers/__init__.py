"""Run tasks in parallel, on this machine or the workers of a Dask scheduler; report progress."""

from exposight.workers.dask_cluster import DaskCluster, as_cluster, choose_workers
from exposight.workers.local_processes import (
    LocalProcesses,
    Progress,
    Workers,
    ignore_progress,
    usual_workers,
)

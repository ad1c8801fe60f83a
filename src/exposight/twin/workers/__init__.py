"""Who does the tasks: processes on this machine, or the workers of a Dask scheduler."""

from exposight.twin.workers.dask_cluster import DaskCluster
from exposight.twin.workers.local_processes import LocalProcesses, Workers, usual_workers

__all__ = [
    "DaskCluster",
    "LocalProcesses",
    "Workers",
    "usual_workers",
]

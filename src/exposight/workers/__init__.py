"""Who does the tasks: processes on this machine, or the workers of a Dask scheduler."""

from exposight.workers.dask_cluster import DaskCluster
from exposight.workers.local_processes import LocalProcesses, Workers, usual_workers
from exposight.workers.progress import Progress, ignore_progress

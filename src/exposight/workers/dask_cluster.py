"""Run tasks in parallel on the workers of a Dask scheduler (extra ``cluster``)."""

import logging
import pickle
import threading
import uuid
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar
from urllib.parse import SplitResult, urlsplit

import numba

from exposight import __version__
from exposight.errors import InputError, MissingFileError, NumericalError
from exposight.workers.local_processes import LocalProcesses, Workers

_WAKE_S = 2.0
"""Interval at which to check that workers are left."""

_SCHEMES = {"tcp", "tls", "ucx", "ws", "wss"}

_GOES_ON = "what was captured is kept: run again to go on"

_NOT_THERE = (
    "no Dask scheduler answers at {!r} ({}); expected an address as tcp://127.0.0.1:8786; start "
    "one: dask scheduler --host 127.0.0.1"
)

_ONE_AT_A_TIME = threading.Lock()
"""A Dask worker may have several threads; one task fills a core and a gigabyte by itself."""

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class DaskCluster:
    """Run tasks in parallel on the workers of a Dask scheduler.

    If a worker dies, another runs its task again. Each process runs one task at a time, however
    many threads it has.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as ``tcp://host:8786``.
    tls : Path, optional
        Folder with ``ca.pem``, ``cert.pem`` and ``key.pem``, for an address ``tls://host:8786``.
    trusted_network : bool
        Whether to use a scheduler on another machine without TLS: whoever reaches it runs code on
        its workers, and it on this machine.
    patience_s : float, s
        How long to wait for a first worker, and for one to return when all are gone; the scheduler
        must answer within a third of it.

    Raises
    ------
    InputError
        If it is no address, or one on another machine without TLS in a network that is not said to
        be trusted, or certificates and address do not go together.
    """

    address: str
    patience_s: float = 30.0
    tls: Path | None = None
    trusted_network: bool = False

    def __post_init__(self) -> None:
        parts = urlsplit(self.address)
        try:
            whole = parts.scheme in _SCHEMES and parts.hostname and parts.port is not None
        except ValueError:  # a port that is no number
            whole = False
        if not whole:
            raise InputError(_NOT_THERE.format(self.address, "not an address"))
        self._check_trust(parts)

    def run(
        self, work: Callable[[_Task], _Result], tasks: Sequence[_Task]
    ) -> Generator[tuple[_Task, _Result]]:
        """Run tasks and yield each with its result as soon as it is done (`Workers`).

        Raises
        ------
        InputError
            If Dask is not installed, there is no scheduler at the address, no worker comes, or one
            has another version of exposight.
        NumericalError
            If workers die over a task again and again, or all of them or the scheduler are lost.
        """
        if not tasks:
            return
        dask = _import_distributed()
        with _quiet(), self._client(dask) as client:
            self._wait_for_workers(client)
            run = uuid.uuid4().hex
            futures = {
                client.submit(
                    run_alone,
                    __version__,
                    pickle.dumps((work, task)),  # as bytes, which Dask does not traverse
                    key=f"exposight-{run}-{number}",
                    pure=False,
                ): task
                for number, task in enumerate(tasks)
            }
            try:
                with self._failures_named(dask):
                    while futures:
                        for future in self._next_done(dask, client, list(futures)):
                            result = future.result()
                            yield futures.pop(future), result
            finally:
                with suppress(Exception):  # the error that ended this matters more
                    client.cancel(list(futures), force=True)

    @contextmanager
    def _client(self, dask: ModuleType) -> Iterator[Any]:
        try:
            client = dask.Client(
                self.address,
                timeout=self.patience_s / 3,
                set_as_default=False,
                security=self._security(dask),
            )
        except (OSError, ValueError) as error:  # TimeoutError is an OSError
            raise InputError(_NOT_THERE.format(self.address, _first_line(error))) from error
        try:
            yield client
        finally:
            with suppress(TimeoutError):  # where the scheduler is lost
                client.close(timeout=_WAKE_S)

    def _check_trust(self, parts: SplitResult) -> None:
        secret = parts.scheme in {"tls", "wss"}
        if not (secret or self.trusted_network or _is_this_machine(parts.hostname or "")):
            msg = (
                f"the Dask scheduler {self.address} is on another machine and without TLS: whoever "
                "reaches its port can run programs on all workers and here. Give a folder with "
                "certificates (--cluster-tls), or, where nobody else is in the network, say so "
                "(--i-trust-this-network)"
            )
            raise InputError(msg)
        if secret and self.tls is None:
            msg = (
                f"the Dask scheduler {self.address} asks for certificates; give the folder with "
                "ca.pem, cert.pem and key.pem (--cluster-tls)"
            )
            raise InputError(msg)
        if self.tls and not secret:
            msg = (
                f"the Dask scheduler {self.address} would not be asked for TLS, though there are "
                f"certificates: expected tls://{parts.netloc}"
            )
            raise InputError(msg)

    def _security(self, dask: ModuleType) -> Any:
        """Return what encrypts the connection and shows who is at its ends; None without TLS."""
        if self.tls is None:
            return None
        files = {name: self.tls / f"{name}.pem" for name in ("ca", "cert", "key")}
        if missing := [path.name for path in files.values() if not path.is_file()]:
            msg = f"{self.tls} must hold ca.pem, cert.pem and key.pem; missing: {missing}"
            raise MissingFileError(msg)
        return dask.Security(
            tls_ca_file=str(files["ca"]),
            tls_client_cert=str(files["cert"]),
            tls_client_key=str(files["key"]),
            require_encryption=True,
        )

    def _wait_for_workers(self, client: Any) -> None:
        try:
            client.wait_for_workers(1, timeout=self.patience_s)
        except TimeoutError as error:
            msg = (
                f"the Dask scheduler at {self.address} has no worker, and none came in "
                f"{self.patience_s:g} s; start some with: dask worker {self.address} --nthreads 1"
            )
            raise InputError(msg) from error

    def _next_done(self, dask: ModuleType, client: Any, futures: list[Any]) -> list[Any]:
        """Return futures that are done, at least one."""
        alone_s = 0.0
        while alone_s < self.patience_s:
            try:
                with client.as_current():
                    done = dask.wait(futures, _WAKE_S, return_when="FIRST_COMPLETED").done
                return [future for future in futures if future in done]  # in their order
            except TimeoutError:
                alone_s = 0.0 if client.nthreads() else alone_s + _WAKE_S
        msg = f"no worker is left at the Dask scheduler {self.address}; {_GOES_ON}"
        raise NumericalError(msg)

    @contextmanager
    def _failures_named(self, dask: ModuleType) -> Iterator[None]:
        """Name failures of the cluster and what to do; errors of the tasks pass unchanged."""
        try:
            yield
        except dask.KilledWorker as error:
            msg = (
                f"workers of the Dask scheduler {self.address} died over the same task again and "
                f"again (out of memory?); {_GOES_ON}, with more memory for each worker"
            )
            raise NumericalError(msg) from error
        except (CancelledError, OSError) as error:
            msg = (
                f"the Dask scheduler at {self.address} was lost ({_first_line(error)}); {_GOES_ON}"
            )
            raise NumericalError(msg) from error
        except ImportError as error:
            msg = (
                f"a worker of the Dask scheduler {self.address} cannot do the task ({error}); "
                f"every worker needs exposight {__version__}"
            )
            raise InputError(msg) from error


def _is_this_machine(host: str) -> bool:
    """Return whether a name or number is of the loopback interface."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:  # another name
        return False


def as_cluster(cluster: str | DaskCluster) -> DaskCluster:
    """Return a cluster by the address of its scheduler, if it is not one already."""
    return DaskCluster(cluster) if isinstance(cluster, str) else cluster


def choose_workers(count: int = 1, cluster: str | DaskCluster | None = None) -> Workers:
    """Return processes of this machine, or the workers of a cluster where one is given.

    Parameters
    ----------
    count : int, 1 or more
        Processes on this machine.
    cluster : str or DaskCluster, optional
        Address of a Dask scheduler on this machine, or a cluster.

    Raises
    ------
    InputError
        If the count is below 1, or more than one process and a cluster are given.
    """
    if cluster is None:
        return LocalProcesses(count)
    if count != 1:
        msg = (
            f"tasks run on processes of this machine or on a cluster, got {count} workers and the "
            f"cluster {as_cluster(cluster).address!r}; choose one"
        )
        raise InputError(msg)
    return as_cluster(cluster)


def run_alone(version: str, pickled: bytes) -> object:
    """Run a pickled task in a Dask worker, one at a time in its process.

    Parameters
    ----------
    version : str
        Version of exposight that submitted the task.
    pickled : bytes
        The callable and its task.

    Raises
    ------
    InputError
        If another version of exposight is installed here.
    """
    from distributed import get_worker

    if version != __version__:
        msg = (
            f"the Dask worker {get_worker().address} has exposight {__version__}, this is "
            f"{version}; install the same version everywhere"
        )
        raise InputError(msg)
    with _ONE_AT_A_TIME:
        numba.set_num_threads(1)  # other workers use the other cores; holds for this thread only
        work, task = pickle.loads(pickled)
        return work(task)


def _import_distributed() -> ModuleType:
    try:
        import distributed
    except ImportError as error:
        msg = (
            f"a cluster needs Dask, which is not installed ({error}); install it with: "
            "pip install 'exposight[cluster]'"
        )
        raise InputError(msg) from error
    return distributed


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's log: what matters is raised."""
    loggers = [
        logger
        for name, logger in logging.root.manager.loggerDict.items()
        if isinstance(logger, logging.Logger)
        and name.split(".")[0] in {"distributed", "tornado", "asyncio"}
    ]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]

"""A sheet measured by the workers of a Dask scheduler on this machine."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import closing
from functools import partial
from itertools import pairwise

import pytest

from exposight.cell import CampaignFolder
from exposight.errors import FileError, InputError, MissingFileError, NumericalError
from exposight.measuring import measure, measure_observations
from exposight.measuring.record import check_record
from exposight.observing import observe_campaign
from exposight.workers import DaskCluster, Workers
from exposight.workers import dask_cluster as cluster_module

distributed = pytest.importorskip(
    "distributed", reason="Dask is not installed: pip install 'exposight[cluster]'"
)

pytestmark = pytest.mark.slow

START_S = 60.0
"""Starting takes about two seconds; a busy machine may take longer to get round to it."""


class Cluster:
    """A scheduler and its workers, of two threads each, in processes of their own."""

    def __init__(self, folder, *options):
        self.processes = []
        self.workers = []
        file = folder / "scheduler.json"
        self.start("scheduler", "--port", "0", "--scheduler-file", file, *options)
        deadline = time.monotonic() + START_S
        while not file.exists() or not file.read_text():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        self.address = json.loads(file.read_text())["address"]

    def start(self, *words):
        options = ("--host", "127.0.0.1", "--no-dashboard")
        self.processes.append(
            subprocess.Popen(
                [sys.executable, "-m", "dask", *map(str, words), *options],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                # A task may see two workers die, not three.
                env={**os.environ, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2"},
            )
        )
        return self.processes[-1]

    def with_workers(self, count):
        """Start workers until so many are alive, and wait until the scheduler knows them."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < count:
            self.workers.append(self.start("worker", self.address, "--nthreads", "2", "--no-nanny"))
        with distributed.Client(self.address, timeout=START_S, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=START_S)
        return self

    def close(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def empty(tmp_path_factory):
    """A scheduler without workers, for the tests that come first."""
    with closing(Cluster(tmp_path_factory.mktemp("cluster"))) as cluster:
        yield cluster


@pytest.fixture
def cluster(empty):
    return empty.with_workers(2)


def test_a_scheduler_without_workers(empty):
    message = "has no worker, and none came in 0.5 s; start some with: dask worker tcp://127"
    with pytest.raises(InputError, match=message):
        list(DaskCluster(empty.address, patience_s=0.5).run(abs, [-1]))


def test_no_task_needs_no_scheduler():
    assert list(DaskCluster("tcp://127.0.0.1:9").run(abs, [])) == []


@pytest.mark.parametrize("workers", [1, 4])  # in this order, and before tests that start two
def test_a_cluster_gives_the_same_bytes_as_one_process(
    tmp_path, alone, empty, cell, sheet_plan, content, reports, workers
):
    cluster = empty.with_workers(workers)
    assert len(cluster.workers) == workers
    measure(
        sheet_plan,
        cell(sheet_plan),
        tmp_path / "c",
        cluster=cluster.address,
        progress=reports,
    )
    assert content(tmp_path / "c") == content(alone)
    assert reports == [(done, 8) for done in (0, 2, 4, 6, 8)]


def test_tasks_come_back_with_their_results(cluster):
    workers: Workers = DaskCluster(cluster.address)
    assert sorted(workers.run(abs, [-3, -2, -1])) == [(-3, 3), (-2, 2), (-1, 1)]


def test_a_process_does_one_task_at_a_time_whatever_its_threads(cluster):
    clock = "__import__('time').monotonic()"
    task = f"(__import__('os').getpid(), {clock}, __import__('time').sleep(0.1), {clock})"
    done = [result for _, result in DaskCluster(cluster.address).run(eval, [task] * 8)]
    for process in {pid for pid, *_ in done}:
        spans = sorted((begun, ended) for pid, begun, _, ended in done if pid == process)
        assert all(ended <= begun for (_, ended), (begun, _) in pairwise(spans))


def test_observing_needs_no_folder(alone, cluster, cell, sheet_plan):
    table = measure_observations(sheet_plan, cell(sheet_plan), cluster=cluster.address)
    assert table.frame.equals(observe_campaign(CampaignFolder(alone)).frame)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_a_worker_that_is_killed_costs_no_capture(
    tmp_path, alone, cluster, cell, sheet_plan, content
):
    def kill_one(_stage, done, _total):
        if done == 2:
            cluster.workers[0].send_signal(signal.SIGKILL)

    measure(
        sheet_plan,
        cell(sheet_plan),
        tmp_path / "c",
        cluster=cluster.address,
        progress=kill_one,
    )
    assert cluster.workers[0].wait() == -signal.SIGKILL
    assert content(tmp_path / "c") == content(alone)


def test_an_interrupt_cancels_what_is_not_begun(
    tmp_path, alone, cluster, cell, sheet_plan, content
):
    def interrupt(_stage, done, _total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure(
            sheet_plan,
            cell(sheet_plan),
            tmp_path / "c",
            cluster=cluster.address,
            progress=interrupt,
        )
    measure(sheet_plan, cell(sheet_plan), tmp_path / "c", cluster=cluster.address)
    assert content(tmp_path / "c") == content(alone)


def test_an_error_of_a_task_is_its_own(cluster, tmp_path):
    work = partial(check_record, tmp_path / "nowhere")
    message = r"nowhere is not the same on .*\(measurement\.json: No such file.*at the same path"
    with pytest.raises(FileError, match=message):
        list(DaskCluster(cluster.address).run(work, ["0" * 64]))


def test_another_folder_at_the_same_path(alone):
    with pytest.raises(FileError, match="another one is there"):
        check_record(alone, "0" * 64)


def test_a_worker_of_another_version(cluster, monkeypatch):
    monkeypatch.setattr(cluster_module, "__version__", "99.0")
    message = r"worker tcp://.* has exposight .*, this is 99\.0; install the same version"
    with pytest.raises(InputError, match=message):
        list(DaskCluster(cluster.address).run(abs, [-1]))


def test_a_worker_that_cannot_load_a_task(cluster):
    missing = "__import__('exposight.not_there')"
    message = "cannot do the task .*not_there.*every worker needs exposight"
    with pytest.raises(InputError, match=message):
        list(DaskCluster(cluster.address).run(eval, [missing]))


QUIET = """
import sys
from exposight.workers import DaskCluster

assert list(DaskCluster(sys.argv[1]).run(abs, [-1])) == [(-1, 1)]
"""


def test_nothing_but_results_is_told(cluster):
    run = subprocess.run(
        [sys.executable, "-c", QUIET, cluster.address], capture_output=True, check=True
    )
    assert (run.stdout, run.stderr) == (b"", b"")


def test_a_task_that_kills_its_workers_is_given_up(cluster):
    cluster.with_workers(3)
    with pytest.raises(NumericalError, match="died over the same task again and again"):
        list(DaskCluster(cluster.address).run(eval, ["__import__('os')._exit(1)"]))


def test_when_no_worker_is_left(cluster):
    results = DaskCluster(cluster.address, patience_s=1.0).run(time.sleep, [0.0, START_S])
    next(results)
    for worker in cluster.workers:
        worker.kill()
    with pytest.raises(NumericalError, match=r"no worker is left .*what was captured is kept"):
        next(results)


def test_when_the_scheduler_is_lost(cluster):
    results = DaskCluster(cluster.address, patience_s=3.0).run(time.sleep, [0.0, START_S])
    next(results)
    cluster.processes[0].kill()
    with pytest.raises(NumericalError, match=r"was lost .*what was captured is kept"):
        next(results)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "http://host:3"])
def test_no_scheduler_there(address):
    with pytest.raises(InputError, match=r"no Dask scheduler answers at .*expected an address as"):
        list(DaskCluster(address, patience_s=1.0).run(abs, [-1]))


def test_without_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"not installed .*pip install 'exposight\[cluster\]'"):
        list(DaskCluster("tcp://127.0.0.1:1").run(abs, [-1]))


def test_workers_here_and_a_cluster_are_not_mixed(sheet_plan, cell):
    with pytest.raises(
        InputError, match=r"got 2 workers and the cluster 'tcp://127\.0\.0\.1:8786'; choose"
    ):
        measure_observations(
            sheet_plan, cell(sheet_plan), workers=2, cluster="tcp://127.0.0.1:8786"
        )


ELSEWHERE = "tcp://192.0.2.1:8786"  # an address that nobody has (RFC 5737)


def test_a_scheduler_on_another_machine_needs_tls_or_trust():
    with pytest.raises(InputError, match="on another machine and without TLS"):
        DaskCluster(ELSEWHERE)
    trusted = DaskCluster(ELSEWHERE, trusted_network=True, patience_s=0.3)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        list(trusted.run(abs, [-1]))


def test_certificates_that_are_missing_or_would_not_be_used(tmp_path):
    (tmp_path / "ca.pem").touch()
    with pytest.raises(MissingFileError, match=r"missing: \['cert.pem', 'key.pem'\]"):
        list(DaskCluster("tls://192.0.2.1:8786", tls=tmp_path).run(abs, [-1]))
    with pytest.raises(InputError, match="on another machine"):
        DaskCluster(ELSEWHERE, tls=tmp_path)


@pytest.fixture
def certificates(tmp_path):
    """An authority's certificate and one that it signed, made by OpenSSL."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("openssl is not installed: apt-get install openssl")

    def make(*words):
        subprocess.run([openssl, *words], cwd=tmp_path, check=True, capture_output=True)

    new_key = ("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-noenc")
    make(*new_key, "-x509", "-days", "2", "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=a")
    make(*new_key, "-keyout", "key.pem", "-out", "request", "-subj", "/CN=127.0.0.1")
    signing = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2")
    make("x509", "-req", "-in", "request", *signing, "-out", "cert.pem")
    return tmp_path


def test_a_cluster_with_certificates(certificates, tmp_path):
    tls = ["--tls-ca-file", "--tls-cert", "--tls-key"]
    names = [certificates / f"{word}.pem" for word in ("ca", "cert", "key")]
    words = [word for pair in zip(tls, names, strict=True) for word in pair]
    with closing(Cluster(tmp_path, "--protocol", "tls", *words)) as cluster:
        assert cluster.address.startswith("tls://")
        cluster.start("worker", cluster.address, "--nthreads", "1", "--no-nanny", *words)
        safe = DaskCluster(cluster.address, tls=certificates)
        assert sorted(safe.run(abs, [-2, -1])) == [(-2, 2), (-1, 1)]
        with pytest.raises(InputError, match="asks for certificates"):
            list(DaskCluster(cluster.address, patience_s=2.0).run(abs, [-1]))

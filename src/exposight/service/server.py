"""Server processes: one accepts connections, and hands each to the worker that has fewest.

Workers that accept by themselves from one socket share connections by chance: of four connections
that are kept open one worker often has three, whose requests then wait for each other.
"""

from __future__ import annotations

import logging
import os
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from exposight.errors import ExposightError, InputError
from exposight.leash import leashed
from exposight.service import worker
from exposight.service.settings import ServerSettings

_START_S = 300.0
"""A worker loads models and compiles within this time."""

_END_S = 15.0
"""A worker that is asked to end finishes its answers within this time, or is killed."""

_SHORT_S, _MOST_SHORT = 5.0, 3
"""Workers that live shorter than this, so often in a row, are not begun again."""

_MOST_CONNECTIONS = 256
"""Open connections of one worker; more wait to be accepted."""

_LOOK_S = 0.5

_logger = logging.getLogger(__name__)


@dataclass(eq=False)
class _Worker:
    """A server process, and how many connections it has."""

    process: subprocess.Popen[bytes]
    channel: socket.socket
    begun: float
    ready: bool = False
    connections: int = 0


def serve(settings: ServerSettings, tell: Callable[[str], None]) -> None:
    """Serve until SIGTERM or SIGINT.

    Parameters
    ----------
    settings : ServerSettings
    tell : callable
        Called with the address once the server listens and every worker is ready.

    Raises
    ------
    InputError
        If the address cannot be listened at.
    ExposightError
        If workers die again and again.
    """
    with listening_socket(settings.host, settings.port) as listener:
        host, port = listener.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        if not hasattr(socket, "send_fds"):  # Windows: one process that accepts itself
            worker.serve_here(settings, listener, lambda: tell(f"http://{shown}:{port}"))
            return
        _Parent(settings, listener).serve(lambda: tell(f"http://{shown}:{port}"))


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address.

    Raises
    ------
    InputError
        If that is not possible.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address[:2], family=family, backlog=128)
    except (OSError, OverflowError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        msg = f"the server cannot listen at {host}, port {port}: {reason}; give another --port"
        raise InputError(msg) from error


class _Parent:
    """Accepts connections, and keeps workers running."""

    def __init__(self, settings: ServerSettings, listener: socket.socket) -> None:
        self._settings, self._listener = settings, listener
        self._workers: list[_Worker] = []
        self._selector = selectors.DefaultSelector()
        self._ending = self._accepting = False
        self._short_lives = 0

    def serve(self, tell_ready: Callable[[], None]) -> None:
        """Run until a signal."""
        handlers = {
            number: signal.signal(number, self._end) for number in (signal.SIGTERM, signal.SIGINT)
        }
        try:
            for _ in range(self._settings.workers):
                self._begin_worker()
            self._await_workers()
            if not self._ending:
                tell_ready()
            while not self._ending:
                self._step()
        finally:
            self._end_workers()
            for number, handler in handlers.items():
                signal.signal(number, handler)

    def _end(self, number: int, frame: object) -> None:
        self._ending = True

    # -- workers --------------------------------------------------------------------------------

    def _begin_worker(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            process = subprocess.Popen(
                leashed(worker.__file__, str(theirs.fileno())),
                stdin=subprocess.PIPE,
                pass_fds=[theirs.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
        assert process.stdin is not None
        with process.stdin, suppress(BrokenPipeError):
            process.stdin.write(self._settings.to_json())
        ours.setblocking(False)
        begun = _Worker(process=process, channel=ours, begun=time.monotonic())
        self._workers.append(begun)
        self._selector.register(ours, selectors.EVENT_READ, begun)

    def _await_workers(self) -> None:
        deadline = time.monotonic() + _START_S
        while not self._ending and not all(each.ready for each in self._workers):
            self._step()
            if time.monotonic() > deadline:
                msg = f"a server process was not ready within {_START_S:g} s"
                raise ExposightError(msg)

    def _step(self) -> None:
        """Wait for something to happen, and do what follows from it."""
        self._accept_or_not()
        heard = [key.data for key, _ in self._selector.select(_LOOK_S)]
        for speaker in filter(None, heard):  # first, so that none is handed to a dead one
            self._hear(speaker)
        if None in heard:
            self._accept()

    def _accept_or_not(self) -> None:
        """Accept where there is a worker with room; else connections wait in the backlog."""
        wanted = self._freest() is not None
        if wanted and not self._accepting:
            self._selector.register(self._listener, selectors.EVENT_READ, None)
        elif self._accepting and not wanted:
            self._selector.unregister(self._listener)
        self._accepting = wanted

    def _freest(self) -> _Worker | None:
        able = [
            each for each in self._workers if each.ready and each.connections < _MOST_CONNECTIONS
        ]
        return min(able, key=lambda each: each.connections, default=None)

    def _accept(self) -> None:
        freest = self._freest()
        if freest is None:
            return
        try:
            connection, _ = self._listener.accept()
        except OSError:  # the client has left already
            return
        with connection:
            try:
                socket.send_fds(freest.channel, [b"c"], [connection.fileno()])
            except OSError:  # the worker died, or does not keep up; the client asks again
                return
        freest.connections += 1

    def _hear(self, speaker: _Worker) -> None:
        """Take note of what a worker says: ready, so many connections closed, or its end."""
        try:
            said = speaker.channel.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            said = b""
        if not said:
            self._replace(speaker)
            return
        if worker.READY in said:
            speaker.ready = True
        speaker.connections -= said.count(worker.CLOSED)

    def _replace(self, dead: _Worker) -> None:
        self._forget(dead)
        if self._ending:
            return
        lived_s = time.monotonic() - dead.begun
        self._short_lives = self._short_lives + 1 if lived_s < _SHORT_S else 0
        if self._short_lives >= _MOST_SHORT or not dead.ready:
            msg = f"a server process ended with status {dead.process.returncode}; see its messages"
            raise ExposightError(msg)
        _logger.warning("server process %d ended and is begun again", dead.process.pid)
        self._begin_worker()

    def _forget(self, dead: _Worker) -> None:
        self._selector.unregister(dead.channel)
        dead.channel.close()
        self._workers.remove(dead)
        _await_end(dead.process, 1.0)

    def _end_workers(self) -> None:
        self._listener.close()
        for each in self._workers:
            with suppress(ProcessLookupError):
                each.process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + _END_S
        for each in self._workers:
            _await_end(each.process, max(0.1, deadline - time.monotonic()))
            each.channel.close()
        self._selector.close()


def _await_end(process: subprocess.Popen[bytes], seconds: float) -> None:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

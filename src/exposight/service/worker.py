"""One server process: answers the connections that it is handed, or that it accepts itself."""

from __future__ import annotations

import asyncio
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import uvicorn

from exposight.service.app import create_app
from exposight.service.limited_protocol import limited_protocol
from exposight.service.settings import ServerSettings

READY, CLOSED = b"r", b"x"
"""What a worker says to its parent: that it takes connections, and that one was closed."""

_KEEP_ALIVE_S = 75
"""How long a connection without requests stays open."""

_GRACE_S = 10
"""How long answers may take after the process was asked to end."""


class _HandedServer(uvicorn.Server):
    """A server whose connections come over a channel from the process that accepts them."""

    def __init__(
        self, config: uvicorn.Config, channel: socket.socket, header_s: float = _KEEP_ALIVE_S
    ) -> None:
        super().__init__(config)
        self._channel, self._header_s = channel, header_s
        self._silent: dict[Any, float] = {}

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Load the application, then take connections."""
        await super().startup(sockets=[])
        loop = asyncio.get_running_loop()
        self._channel.setblocking(False)
        loop.add_reader(self._channel, self._take)
        self._channel.send(READY)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Take no more connections, and finish what was begun."""
        asyncio.get_running_loop().remove_reader(self._channel)
        await super().shutdown(sockets)

    async def on_tick(self, counter: int) -> bool:
        """Look after connections once a second."""
        if counter % 10 == 0:
            self._close_silent()
        return await super().on_tick(counter)

    def _close_silent(self) -> None:
        """Close connections on which no request has come, or no more than a part of its header.

        Those that wait after an answer have a time limit of uvicorn's, and bodies one of theirs.
        """
        now, before, self._silent = time.monotonic(), self._silent, {}
        for each in self.server_state.connections:
            connection: Any = each
            answers = connection.cycle is not None and not connection.cycle.response_complete
            if answers or connection.timeout_keep_alive_task is not None:
                continue
            since = self._silent[connection] = before.get(connection, now)
            if now - since > self._header_s:
                connection.transport.close()

    def _take(self) -> None:
        """Take the connections that have come."""
        while True:
            try:
                said, descriptors, _, _ = socket.recv_fds(self._channel, 1, 1)
            except BlockingIOError:
                return
            except OSError:
                said, descriptors = b"", []
            if not said:  # the parent has ended
                asyncio.get_running_loop().remove_reader(self._channel)
                self.should_exit = True
                return
            for each in descriptors:
                asyncio.get_running_loop().create_task(self._serve_one(socket.socket(fileno=each)))

    async def _serve_one(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        protocol: asyncio.Protocol = self.config.http_protocol_class(  # type: ignore[call-arg]
            config=self.config, server_state=self.server_state, app_state=self.lifespan.state
        )
        _when_closed(protocol, self._say_closed)
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            await asyncio.get_running_loop().connect_accepted_socket(lambda: protocol, connection)
        except OSError:  # the client has left already
            connection.close()
            self._say_closed()

    def _say_closed(self) -> None:
        with suppress(OSError):  # the parent has ended
            self._channel.send(CLOSED)


def _when_closed(protocol: Any, call: Callable[[], None]) -> None:
    """Have a function called when a protocol's connection is closed."""
    lost = protocol.connection_lost

    def connection_lost(error: Exception | None) -> None:
        lost(error)
        call()

    protocol.connection_lost = connection_lost


def _config(settings: ServerSettings) -> uvicorn.Config:
    app = create_app(settings.folder, limits=settings.limits, token=settings.token)
    return uvicorn.Config(
        app,
        access_log=False,
        log_level="warning",
        lifespan="on",
        http=limited_protocol(),
        ws="none",
        proxy_headers=False,
        server_header=False,
        date_header=False,
        timeout_keep_alive=_KEEP_ALIVE_S,
        timeout_graceful_shutdown=_GRACE_S,
    )


class _TellingServer(uvicorn.Server):
    """A server that says when it is ready."""

    def __init__(self, config: uvicorn.Config, tell_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._tell_ready = tell_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Load the application, listen, and say so."""
        await super().startup(sockets)
        self._tell_ready()


def serve_here(
    settings: ServerSettings, listener: socket.socket, tell_ready: Callable[[], None]
) -> None:
    """Serve in this process, which accepts connections itself."""
    _TellingServer(_config(settings), tell_ready).run(sockets=[listener])


def main() -> None:
    """Serve the connections that come over the channel, as standard input says."""
    settings = ServerSettings.from_json(sys.stdin.buffer.read())
    with socket.socket(fileno=int(sys.argv[1])) as channel:
        _HandedServer(_config(settings), channel, settings.limits.request_s).run()


if __name__ == "__main__":
    main()

"""HTTP as a worker reads it: the header of a request is no larger than a limit."""

from __future__ import annotations

import asyncio
import json

MOST_HEADER_BYTES = 64 * 1024
"""Size of a request's header beyond which no more of it is read."""


def limited_protocol() -> type[asyncio.Protocol] | str:
    """Return what uvicorn reads requests with.

    Its reader in Python, h11, has such a limit itself; the one in C, httptools, has none.
    """
    try:
        from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
    except ModuleNotFoundError:  # there is none for this Python
        return "h11"

    class LimitedProtocol(HttpToolsProtocol):
        """Counts what came since the last header was complete, or the last piece of a body."""

        _pending_bytes = 0

        def data_received(self, data: bytes) -> None:
            self._pending_bytes += len(data)
            super().data_received(data)
            if self._pending_bytes > MOST_HEADER_BYTES and not self.transport.is_closing():
                if self.cycle is None or self.cycle.response_complete:
                    self.transport.write(_refusal())
                self.transport.close()

        def on_headers_complete(self) -> None:
            self._pending_bytes = 0
            super().on_headers_complete()

        def on_body(self, body: bytes) -> None:
            self._pending_bytes = 0
            super().on_body(body)

        def on_message_complete(self) -> None:
            self._pending_bytes = 0
            super().on_message_complete()

    return LimitedProtocol


def _refusal() -> bytes:
    message = f"the header has more than {MOST_HEADER_BYTES // 1024} kB"
    body = json.dumps({"error": message, "kind": "TooLarge", "facts": {}}).encode()
    head = (
        "HTTP/1.1 431 Request Header Fields Too Large\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + body

"""Requests of a served cell's commands, on loopback: a line of JSON each, and its answer."""

from __future__ import annotations

import json
import socketserver
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from exposight.errors import ExposightError
from exposight.files import write_durably
from exposight.geometry import RigidTransform
from exposight.twin import cell_command

LOOPBACK = "127.0.0.1"

COMMAND_S = 120.0
"""What a command may take: tracing the first view compiles loops, which takes long."""

_LONGEST_REQUEST = 10_000
_WAIT_S = 10.0


class RequestServer(socketserver.ThreadingTCPServer):
    """Answers the commands of a served cell until it is closed.

    Parameters
    ----------
    folder : Path
        Gets a file with the port, which the commands read.
    answer : callable
        Takes a request, and returns what the command prints.
    """

    daemon_threads = True

    def __init__(self, folder: Path, answer: Callable[[object], str]) -> None:
        super().__init__((LOOPBACK, 0), _Handler)
        self.answer = answer
        self._port_file = folder / "port"
        write_durably(self._port_file, str(self.server_address[1]).encode())
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def command(self, *arguments: str) -> dict[str, Any]:
        """Return a command as a cell's file has it."""
        script = [sys.executable, "-I", cell_command.__file__, str(self._port_file)]
        return {"command": [*script, *arguments], "timeout_s": COMMAND_S}

    @property
    def move_table(self) -> dict[str, Any]:
        """The table ``[move]`` of the cell's file; `requested_pose` reads its request."""
        return {**self.command("move", "{view}", "{matrix}"), "notation": "matrix"}

    def close(self) -> None:
        """End it."""
        self.shutdown()
        self.server_close()


def requested_pose(matrix: str) -> RigidTransform:
    """Return the pose of a request to move.

    Raises
    ------
    ValueError, PoseError
        If it is none.
    """
    return RigidTransform.from_matrix(np.array(matrix.split(","), dtype=np.float64).reshape(4, 4))


def printed_pose(pose: RigidTransform) -> str:
    """Return a pose as the command prints it, every digit of it."""
    return " ".join(f"{each:.17g}" for each in pose.to_matrix().ravel())


class _Handler(socketserver.StreamRequestHandler):
    """Answers one request, a line of JSON."""

    timeout = _WAIT_S

    def handle(self) -> None:
        try:
            request = json.loads(self.rfile.readline(_LONGEST_REQUEST))
            answer = {"said": self.server.answer(request)}  # type: ignore[attr-defined]
        except (ExposightError, ValueError, OSError) as error:
            answer = {"error": str(error)}
        self.wfile.write(json.dumps(answer).encode() + b"\n")

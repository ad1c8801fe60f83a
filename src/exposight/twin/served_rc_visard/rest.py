"""The REST interface, version 2, after its public documentation: system, nodes and parameters."""

from __future__ import annotations

import http.server
import json
import threading
import time
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

from exposight.twin.request_server import LOOPBACK
from exposight.twin.served_rc_visard.device import ServedDevice

_ROOT = "/api/v2/"
_LONGEST_BODY = 100_000
_WAIT_S = 10.0


class RestServer(http.server.ThreadingHTTPServer):
    """Answers on a free port of loopback until it is closed.

    Parameters
    ----------
    device : ServedDevice
    """

    daemon_threads = True

    def __init__(self, device: ServedDevice) -> None:
        super().__init__((LOOPBACK, 0), _Handler)
        self.device = device
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.server_address[1])

    def close(self) -> None:
        """End it."""
        self.shutdown()
        self.server_close()


class _Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = _WAIT_S
    server: RestServer

    def do_GET(self) -> None:  # the name that http.server calls
        self._answer(None)

    def do_PUT(self) -> None:  # likewise
        length = int(self.headers.get("Content-Length") or 0)
        if length > _LONGEST_BODY:
            self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, {"message": "too long"})
            return
        try:
            self._answer(json.loads(self.rfile.read(length) or b"{}"))
        except ValueError:
            self._send(HTTPStatus.BAD_REQUEST, {"message": "the body is not JSON"})

    def _answer(self, body: Any) -> None:
        wrong = self.server.device.misbehaviour
        time.sleep(wrong.delay_s)
        if wrong.dropped > 0:
            wrong.dropped -= 1
            self.close_connection = True
        elif wrong.too_many > 0:
            wrong.too_many -= 1
            self._send(HTTPStatus.TOO_MANY_REQUESTS, {"message": "too many requests"})
        elif wrong.faults > 0:
            wrong.faults -= 1
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, {"message": "internal fault"})
        else:
            self._send(*self._resource(body))

    def _resource(self, body: Any) -> tuple[HTTPStatus, Any]:
        url = urlsplit(self.path)
        parts = url.path.removeprefix(_ROOT).strip("/").split("/")
        try:
            if self.command == "PUT":
                return HTTPStatus.OK, self._put(parts, body)
            return HTTPStatus.OK, self._get(parts, parse_qs(url.query).get("name"))
        except (KeyError, IndexError):
            return HTTPStatus.NOT_FOUND, {"message": f"there is no {url.path}"}
        except (TypeError, ValueError) as error:
            return HTTPStatus.BAD_REQUEST, {"message": str(error)}

    def _get(self, parts: list[str], names: list[str] | None) -> Any:
        device = self.server.device
        match parts:
            case ["system"]:
                now = device.time_s()
                return {
                    "serial": "02900000",
                    "ready": True,
                    "time": now,
                    "uptime": time.monotonic(),
                }
            case ["pipelines"]:
                return [{"pipeline": "0", "type": "rc_visard", "status": "running"}]
            case ["pipelines", "0", "nodes"]:
                return [_node(device, name) for name in device.nodes]
            case ["pipelines", "0", "nodes", node]:
                return _node(device, node)
            case ["pipelines", "0", "nodes", node, "parameters"]:
                return [device.nodes[node][name] for name in names or device.nodes[node]]
            case ["pipelines", "0", "nodes", node, "parameters", name]:
                return device.nodes[node][name]
        raise KeyError(parts)

    def _put(self, parts: list[str], body: Any) -> Any:
        device = self.server.device
        if code := device.misbehaviour.return_code:
            return {"return_code": {"value": code, "message": "simulated fault"}}
        match parts:
            case ["pipelines", "0", "nodes", node, "parameters"]:
                return [self._set(node, each["name"], each["value"]) for each in body]
            case ["pipelines", "0", "nodes", node, "parameters", name]:
                return self._set(node, name, body["value"])
            case ["pipelines", "0", "nodes", node, "services", "reset_defaults"]:
                device.reset(node)
                done = {"return_code": {"value": 0, "message": ""}}
                return {"name": "reset_defaults", "response": done}
        raise KeyError(parts)

    def _set(self, node: str, name: str, value: object) -> dict[str, Any]:
        """Set a parameter and return it with the value that was sent, whatever it has now."""
        self.server.device.set(node, name, value)
        return {**self.server.device.nodes[node][name], "value": value}

    def _send(self, status: HTTPStatus, answer: Any) -> None:
        content = json.dumps(answer).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Write no line for each request."""


def _node(device: ServedDevice, name: str) -> dict[str, Any]:
    return {"name": name, "status": "running", "parameters": list(device.nodes[name])}

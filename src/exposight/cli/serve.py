"""``exposight serve``: a folder's models, campaigns and plans over HTTP."""

from __future__ import annotations

import ipaddress
import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.types import PositiveInt
from cyclopts.validators import Number

from exposight.cli.app import UsageError
from exposight.cli.result import Result
from exposight.cli.terminal import console
from exposight.errors import ExposightError
from exposight.files import read_text

TOKEN_VARIABLE = "EXPOSIGHT_TOKEN"
"""Environment variable that may hold the token."""


def serve_command(
    folder: Path,
    /,
    *,
    host: str = "127.0.0.1",
    port: Annotated[int, Parameter(validator=Number(gte=0, lte=65535))] = 8765,
    workers: Annotated[int, Parameter(validator=Number(gte=1, lte=64))] = 2,
    token_file: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    max_body_mb: Annotated[float, Parameter(metavar="MB", validator=Number(gt=0))] = 64.0,
    max_megapixels: Annotated[float, Parameter(metavar="MPX", validator=Number(gt=0))] = 50.0,
    max_seconds: Annotated[float, Parameter(metavar="S", validator=Number(gt=0))] = 60.0,
    max_busy: PositiveInt = 2,
) -> Result:
    r"""Answer over HTTP what models, campaigns and plans in a folder tell.

    Cell controllers ask which exposures to take and what to capture next, and people watch runs on
    the page at the server's address (docs/service.md). The server listens on this machine alone
    unless another address is given, which needs a token. Ctrl-C or SIGTERM ends it.

    For example:

        exposight serve demo-output

        exposight serve demo-output --host 0.0.0.0 --token-file token.txt

    Parameters
    ----------
    folder
        What is served: models, campaigns, plans, lists of features and sensors beneath it.
    host
        Address to listen at.
    port
        Port to listen at; 0 takes a free one.
    workers
        Server processes.
    token_file
        File with the token that clients must send, 16 characters or more; by default the
        environment variable EXPOSIGHT_TOKEN.
    max_body_mb
        Largest body of a request, MB.
    max_megapixels
        Most pixels of an image, millions.
    max_seconds
        Longest time that a request may take, s.
    max_busy
        Requests that each process computes at once.
    """
    try:
        from exposight.service.guard import LEAST_TOKEN, Limits
        from exposight.service.server import serve
        from exposight.service.settings import ServerSettings
    except ModuleNotFoundError as error:
        msg = f"{error.name} is not installed: pip install 'exposight[service]'"
        raise ExposightError(msg) from error
    token = os.environ.get(TOKEN_VARIABLE) if token_file is None else _token(token_file)
    if token is not None and (len(token) < LEAST_TOKEN or not token.isascii()):
        msg = f"a token has {LEAST_TOKEN} or more ASCII characters, got {len(token)}"
        raise UsageError(msg)
    if token is None and not _is_loopback(host):
        msg = (
            f"whoever reaches {host} could ask the server: give --token-file, or the token in "
            f"{TOKEN_VARIABLE}"
        )
        raise UsageError(msg)
    if not folder.is_dir():
        msg = f"no folder at {folder}: give the folder with models and campaigns to serve"
        raise UsageError(msg)
    limits = replace(
        Limits(),
        body_bytes=int(max_body_mb * 1e6),
        pixels=int(max_megapixels * 1e6),
        request_s=max_seconds,
        busy=max_busy,
    )
    settings = ServerSettings(
        folder=folder.resolve(), host=host, port=port, workers=workers, token=token, limits=limits
    )
    console().print("loading models, compiling where this was not done before …")
    serve(settings, lambda address: console().print(f"serving {folder} at {address}"))
    return Result(title="the server has ended")


def _token(path: Path) -> str:
    return read_text(path, "token").strip()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"

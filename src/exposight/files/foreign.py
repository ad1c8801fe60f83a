"""Files of others: whatever a parser raises becomes our error; native parsers run in a process.

A library's parser may raise anything, and a native one may write out of bounds or eat the machine
on one wrong byte. `parsing` stands round every parser; `parse_apart` runs the native ones, which
nobody can check, in a process that has no more time and memory than it is given.
"""

import importlib.util
import io
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from exposight.errors import ExposightError, FormatError
from exposight.leash import leashed

PARSER_MEMORY_GB = 4.0
PARSER_SECONDS = 120.0


@contextmanager
def parsing(source: Path | str, what: str) -> Iterator[None]:
    """Turn whatever is raised in the block by a parser of a file into our error.

    Parameters
    ----------
    source : Path or str
        The file, for messages.
    what : str
        What it should be, for messages: ``PLY cloud``.

    Raises
    ------
    FormatError
        Of all exceptions but exposight's own and those that end the program.
    """
    try:
        yield
    except (ExposightError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except MemoryError as error:
        msg = f"{source} cannot be read as a {what}: it asks for more memory than there is"
        raise FormatError(msg) from error
    except RecursionError as error:
        msg = f"{source} is not a readable {what}: it is nested too deeply"
        raise FormatError(msg) from error
    except BaseException as error:  # a panic of Rust is no Exception
        said = (str(error).strip().splitlines() or [""])[0][:200]
        reason = f"{type(error).__name__}: {said}" if said else type(error).__name__
        msg = f"{source} is not a readable {what} ({reason}); was it cut off or damaged?"
        raise FormatError(msg) from error


def parse_apart(
    parser: Path,
    data: bytes,
    *,
    source: Path | str,
    what: str,
    seconds: float = PARSER_SECONDS,
    memory_gb: float = PARSER_MEMORY_GB,
    **options: str,
) -> dict[str, np.ndarray[Any, Any]]:
    """Parse bytes in a process of its own, which may crash or run out of time or memory.

    Parameters
    ----------
    parser : Path
        File of a module with ``parse(data: bytes, **options: str) -> dict of arrays``. It is run
        by itself, so it imports neither exposight nor more than it needs.
    data : bytes
        The file's content.
    source, what
        As in `parsing`.
    seconds : float, s
        Time after which it is ended.
    memory_gb : float, GB
        Address space that it may take beyond what its imports took. Windows has no such limit.
    **options : str
        Handed to the parser.

    Returns
    -------
    dict of ndarray
        What the parser returned.

    Raises
    ------
    FormatError
        If it raises, crashes, or takes more time or memory.
    """
    request = _packed({"data": np.frombuffer(data, dtype=np.uint8)})
    settings = [f"{name}={value}" for name, value in options.items()]
    command = leashed(__file__, str(parser), f"{memory_gb:g}", f"{seconds:.0f}", *settings)
    try:
        # In a session of its own, as Ctrl-C is for the process that waits and then ends it.
        done = subprocess.run(
            command,
            input=request,
            capture_output=True,
            timeout=seconds,
            check=False,
            start_new_session=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONFAULTHANDLER": ""},
        )
    except subprocess.TimeoutExpired as error:
        msg = f"{source} was given up as a {what}: reading it took more than {seconds:g} s"
        raise FormatError(msg) from error
    if done.returncode < 0 or done.returncode > 1:
        msg = (
            f"{source} is not a readable {what}: its parser crashed on it (exit status "
            f"{done.returncode}); was it cut off or damaged?"
        )
        raise FormatError(msg)
    with parsing(source, what):
        answer = _unpacked(done.stdout)
        if "error" in answer:
            msg = f"{source} is not a readable {what} ({answer['error']})"
            raise FormatError(msg)
        return answer


def _packed(arrays: Mapping[str, Any]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _unpacked(data: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        return dict(archive)


def _serve(parser: str, memory_gb: str, seconds: str, *options: str) -> None:
    """Parse standard input in this process and write the arrays to standard output."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a parser prints is no answer
    spec = importlib.util.spec_from_file_location("parser", parser)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    data = _unpacked(sys.stdin.buffer.read())["data"].tobytes()
    _limit_this_process(float(memory_gb), int(seconds))
    try:
        answer = module.parse(data, **dict(option.split("=", 1) for option in options))
    except MemoryError:
        answer = {"error": f"it asks for more than {memory_gb} GB of memory"}
    except BaseException as error:
        said = (str(error).strip().splitlines() or [""])[0][:200]
        answer = {"error": said or type(error).__name__}
    answers.write(_packed(answer))
    answers.close()


def _limit_this_process(memory_gb: float, seconds: int) -> None:
    """Limit address space and processor time, where the system can."""
    if sys.platform == "win32":
        return
    import resource

    taken = (
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        if (sys.platform == "linux")
        else 0
    )
    limit = taken + int(memory_gb * 1e9)
    with suppress(ValueError, OSError):  # macOS refuses some
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    # A parent that was killed cannot end it any more.
    resource.setrlimit(resource.RLIMIT_CPU, (seconds + 1, seconds + 2))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    _serve(*sys.argv[1:])

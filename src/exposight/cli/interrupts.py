"""Ctrl-C while modules are imported: nothing is lost then, so the program ends at once.

An import that `KeyboardInterrupt` tears open ends in a traceback at best; compiled modules also
swallow it, or turn it into another error. It imports next to nothing, to be there first.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = 130  # the exit status, as shells have it: 128 + SIGINT


@contextmanager
def ended_by_interrupts() -> Iterator[None]:
    """Let Ctrl-C end the program in a line, without a traceback, within this block."""
    ours = (
        threading.current_thread() is threading.main_thread()  # the others cannot set handlers
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler  # who ignores it, may
    )
    if not ours:
        yield
        return
    signal.signal(signal.SIGINT, _end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(*_: object) -> None:
    message = "stopped by Ctrl-C before anything was begun"
    if "--json" in sys.argv:  # as `print_error` has it, which is not imported yet
        document = (
            f'{{\n  "error": {{\n    "type": "Interrupted",\n    "message": "{message}"\n  }}\n}}\n'
        )
        os.write(1, document.encode())
    else:
        os.write(2, f"error: {message}\n".encode())
    os._exit(INTERRUPTED)  # no clean-up: it would run through modules that are half there

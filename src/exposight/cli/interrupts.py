"""Signals that end the program: Ctrl-C (SIGINT) and the polite request to end (SIGTERM).

While a command runs, both raise `KeyboardInterrupt`, so that everything is cleaned up. While
modules are imported nothing is lost, and the program ends at once: an import that is torn open ends
in a traceback at best; compiled modules also swallow the interrupt, or make another error of it.
This module imports next to nothing, to be there first.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}
_last = signal.SIGINT


def stopped_by() -> str:
    """Return what ended the program, for messages: Ctrl-C, unless it was SIGTERM."""
    return f"stopped by {_NAMES[_last]}"


def interrupted_status() -> int:
    """Return the exit status of a program so ended, as shells have it: 128 + the signal."""
    return 128 + _last


@contextmanager
def interrupts_raised() -> Iterator[None]:
    """Let SIGTERM raise `KeyboardInterrupt` within this block, as Ctrl-C does by itself."""
    _remember(signal.SIGINT)  # which needs no handler of ours
    with _handled({signal.SIGTERM: signal.SIG_DFL}, _raise):
        yield


@contextmanager
def ended_by_interrupts() -> Iterator[None]:
    """Let both end the program in a line, without a traceback, within this block."""
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    with _handled(usual, _end):
        yield


@contextmanager
def _handled(usual: dict[signal.Signals, object], handler: object) -> Iterator[None]:
    """Handle signals within this block, where they are handled as usual: who ignores them, may."""
    before = {}
    if threading.current_thread() is threading.main_thread():  # the others cannot set handlers
        before = {each: signal.getsignal(each) for each in usual}
    ours = [each for each, now in before.items() if now in {usual[each], _raise}]
    for each in ours:
        signal.signal(each, handler)  # type: ignore[arg-type]
    try:
        yield
    finally:
        for each in ours:
            signal.signal(each, before[each])


def _raise(number: int, _frame: FrameType | None) -> None:
    _remember(number)
    raise KeyboardInterrupt


def _end(number: int, _frame: FrameType | None) -> None:
    _remember(number)
    message = f"{stopped_by()} before anything was begun"
    if "--json" in sys.argv:  # as `print_error` has it, which is not imported yet
        document = (
            f'{{\n  "error": {{\n    "type": "Interrupted",\n    "message": "{message}"\n  }}\n}}\n'
        )
        os.write(1, document.encode())
    else:
        os.write(2, f"error: {message}\n".encode())
    os._exit(interrupted_status())  # no clean-up: it would run through modules that are half there


def _remember(number: int) -> None:
    global _last
    _last = signal.Signals(number)

"""Processes that end with the one that began them, however that one ends.

A process that is killed cannot end those that it began. Linux does it for them; elsewhere they look
themselves whether their parent is there. Run as a script, this file runs another on the leash.
"""

import os
import runpy
import signal
import sys
import threading
import time

_PR_SET_PDEATHSIG = 1
_LOOK_S = 1.0


def end_with_parent(parent: int) -> None:
    """Have this process end when its parent does.

    Parameters
    ----------
    parent : int
        The parent's process number, as it told: it may have died meanwhile. On Linux the thread of
        the parent that began this process must last as long as its work.
    """
    if sys.platform == "win32":  # where a parent's number outlives it
        return
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        threading.Thread(target=_look_for, args=(parent,), daemon=True).start()
    if os.getppid() != parent:
        os._exit(1)


def leashed(script: str, *arguments: str) -> list[str]:
    """Return the command that runs a script, without its folder on the path, on this leash."""
    return [sys.executable, "-P", __file__, str(os.getpid()), script, *arguments]


def _look_for(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)


if __name__ == "__main__":
    end_with_parent(int(sys.argv[1]))
    del sys.argv[:2]
    runpy.run_path(sys.argv[0], run_name="__main__")

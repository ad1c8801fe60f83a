"""How much memory large matrices take, compared with what there is before they are made."""

from pathlib import Path

from exposight.errors import OutOfMemoryError

DOUBLE_BYTES = 8
_MEMINFO = Path("/proc/meminfo")
# Less is never refused, and not worth looking up what there is.
_LITTLE = 100_000_000
_CONTAINER = Path("/sys/fs/cgroup")


def square_bytes(rows: int) -> int:
    """Return what a square matrix of float64 takes."""
    return DOUBLE_BYTES * rows * rows


def available_bytes() -> int | None:
    """Return the memory that is free or can be freed here; None where nothing tells.

    Of the machine, and of the container (cgroup v2) where one limits it. Linux tells; elsewhere
    nothing is refused.
    """
    found = [
        free for free in (_machine_bytes(), _container_bytes()) if free is not None and free >= 0
    ]
    return min(found, default=None)


def check_memory(needed: int, what: str, remedy: str) -> None:
    """Refuse what would not fit into memory, before any of it is allocated.

    Parameters
    ----------
    needed : int
        Bytes.
    what : str
        What takes them, for the message: "an exact process of 40000 observations".
    remedy : str
        What to do instead.

    Raises
    ------
    OutOfMemoryError
        If less is available.
    """
    available = available_bytes() if needed > _LITTLE else None
    if available is not None and needed > available:
        msg = (
            f"{what} takes {needed / 1e9:.1f} GB of memory, and {available / 1e9:.1f} GB are "
            f"available; {remedy}"
        )
        raise OutOfMemoryError(msg)


def _machine_bytes() -> int | None:
    for line in _lines(_MEMINFO):
        if line.startswith("MemAvailable:"):
            return 1024 * int(line.split()[1])
    return None


def _container_bytes() -> int | None:
    limit = next(iter(_lines(_CONTAINER / "memory.max")), "max").strip()
    if not limit.isdecimal():
        return None
    held = [line for line in _lines(_CONTAINER / "memory.stat") if line.startswith("anon ")]
    return int(limit) - sum(int(line.split()[1]) for line in held)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError:  # no such system
        return []

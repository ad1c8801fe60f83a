"""Commands of the user's: the bridge to projectors, robots and whatever else stands in a cell."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from exposight.errors import InputError, SensorError

_PLACEHOLDER = re.compile(r"\{([a-z_]+)\}")

_SHOWN = 400
"""Letters of a failed command's output that a message shows."""


@dataclass(frozen=True, kw_only=True)
class CellCommand:
    """A command and what is put into it; it runs without a shell.

    Parameters
    ----------
    command : tuple of str
        Program and arguments; ``{name}`` in an argument is replaced by a value.
    timeout_s : float, s
        After which it is ended.

    Raises
    ------
    InputError
        If there is no program, or the time is not above 0.
    """

    command: tuple[str, ...]
    timeout_s: float = 30.0

    def __post_init__(self) -> None:
        if not self.command or not self.command[0].strip():
            msg = 'a command needs a program: command = ["program", "argument"]'
            raise InputError(msg)
        if not self.timeout_s > 0:
            msg = f"a command's timeout_s must be above 0 s, got {self.timeout_s:g}"
            raise InputError(msg)

    def check_placeholders(
        self, allowed: Sequence[str], what: str, needed: str | None = None
    ) -> None:
        """Check that only known placeholders are used, and one that is needed.

        Raises
        ------
        InputError
            If another one is, or that one is not.
        """
        used = [name for part in self.command for name in _PLACEHOLDER.findall(part)]
        unknown = [name for name in used if name not in allowed]
        if unknown:
            known = ", ".join(f"{{{name}}}" for name in allowed)
            msg = f"{what}: unknown placeholder {{{unknown[0]}}} in its command; there are {known}"
            raise InputError(msg)
        if needed is not None and needed not in used:
            msg = f"{what}: its command has no {{{needed}}}, so it would do the same each time"
            raise InputError(msg)

    def run(self, what: str, values: Mapping[str, str]) -> str:
        """Run the command and return what it printed.

        Parameters
        ----------
        what : str
            What it does, for messages.
        values : mapping of str to str
            Of the placeholders.

        Raises
        ------
        SensorError
            If it cannot be started, fails, or takes too long.
        """
        filled = [
            _PLACEHOLDER.sub(lambda found: values.get(found[1], found[0]), part)
            for part in self.command
        ]
        try:
            done = subprocess.run(
                filled,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=self.timeout_s,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            msg = f"{what}: {filled[0]} did not end within {self.timeout_s:g} s and was ended"
            raise SensorError(msg) from error
        except (OSError, ValueError) as error:
            msg = f"{what}: {filled[0]} cannot be run: {error}"
            raise SensorError(msg) from error
        if done.returncode != 0:
            said = (done.stderr or done.stdout).decode(errors="replace").strip()[-_SHOWN:]
            msg = f"{what}: {filled[0]} failed with code {done.returncode}: {said or 'no message'}"
            raise SensorError(msg)
        return done.stdout.decode(errors="replace")

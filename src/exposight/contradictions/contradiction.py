"""What a check returns, and what becomes of it."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from exposight.errors import ContradictionError, InputError, did_you_mean


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """Two inputs that say the same thing twice, and do not agree.

    Parameters
    ----------
    check : str
        Name of the check, in lower case with hyphens; `despite` takes it.
    compared : str
        What was held against what.
    found : str
        By how much they differ, with the figure and its unit.
    explanation : str
        What would explain it, and what to do; empty where nothing tried does.
    is_error : bool
        True where the result cannot be right; False where it may be.
    """

    check: str
    compared: str
    found: str
    explanation: str = ""
    is_error: bool = True

    def __str__(self) -> str:
        text = f"{self.compared}: {self.found}"
        return f"{text}; {self.explanation}" if self.explanation else text


def settle(
    found: Iterable[Contradiction | None], despite: Collection[str] | None = None
) -> tuple[Contradiction, ...]:
    """Return the contradictions that a result may bear, and raise for those that it cannot.

    Parameters
    ----------
    found : iterable of Contradiction or None
        What the checks returned.
    despite : collection of str, optional
        Names of checks whose errors are accepted: they are returned with the warnings. None where
        nothing can be made of the input all the same.

    Returns
    -------
    tuple of Contradiction
        Warnings, and errors that were accepted, each once.

    Raises
    ------
    ContradictionError
        If an error is among them that was not accepted.
    """
    contradictions = tuple(dict.fromkeys(each for each in found if each is not None))
    errors = [
        each for each in contradictions if each.is_error and each.check not in (despite or ())
    ]
    if errors:
        msg = ". ".join(f"contradiction: {each}" for each in errors)
        if despite is not None:
            names = dict.fromkeys(each.check for each in errors)
            msg += f" ({' '.join(f'--despite {name}' for name in names)} goes on all the same)"
        raise ContradictionError(msg, contradictions)
    return contradictions


def check_names(despite: Collection[str], known: Collection[str]) -> None:
    """Refuse names of checks that there are not.

    Raises
    ------
    InputError
        If one is unknown.
    """
    for name in despite:
        if name not in known:
            msg = f"no check is called {name!r}; there are {', '.join(known)}"
            raise InputError(msg + did_you_mean(name, known))

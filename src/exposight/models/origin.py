"""What observations are of, kept with a model and compared with what it is asked about."""

from __future__ import annotations

from dataclasses import dataclass

import polars as pl

from exposight.errors import ObservationError
from exposight.observing import ObservationTable

ORIGIN_COLUMNS = ("sensor", "tcp", "part", "finish")


@dataclass(frozen=True, kw_only=True)
class Origin:
    """What observations are of; empty where the table does not say.

    Parameters
    ----------
    sensor, tcp, part, finish : str
        As in the columns of observation tables.
    """

    sensor: str = ""
    tcp: str = ""
    part: str = ""
    finish: str = ""

    @classmethod
    def of(cls, table: ObservationTable) -> Origin:
        """Return what a table's rows are of, all of the same.

        Raises
        ------
        ObservationError
            If they are of several sensors, TCPs or finishes.
        """
        values = {}
        for name in ORIGIN_COLUMNS:
            named = table.frame[name].drop_nulls().unique().sort().to_list()
            named = [each for each in named if each]
            if len(named) > 1 and name != "part":
                listed = ", ".join(map(repr, named))
                msg = (
                    f"the rows are of more than one {name}: {listed}; a model holds for one, so "
                    f"train one for each (filter the table by column {name!r})"
                )
                raise ObservationError(msg)
            values[name] = named[0] if len(named) == 1 else ""
        return cls(**values)

    def other_finishes(self, frame: pl.DataFrame) -> dict[str, str]:
        """Return the features of a frame that are on another finish, by name, and which it is."""
        if not self.finish or "finish" not in frame.columns:
            return {}
        rows = zip(frame["feature"].to_list(), frame["finish"].to_list(), strict=True)
        return {name: finish for name, finish in rows if finish and finish != self.finish}

    def contradictions(self, frame: pl.DataFrame) -> dict[str, str]:
        """Return which of sensor, tcp and finish a frame has otherwise, in words, by name."""
        found: dict[str, str] = {}
        for name in ("sensor", "tcp", "finish"):
            learnt = getattr(self, name)
            if not learnt or name not in frame.columns:
                continue
            others = [each for each in set(frame[name].to_list()) if each and each != learnt]
            if others:
                what = {"sensor": "sensor", "tcp": "tool centre point", "finish": "finish"}[name]
                found[name] = f"another {what}: {others[0]!r}, learnt on {learnt!r}"
        return found

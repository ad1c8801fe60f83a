"""A whole study: everything a report of it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from exposight.errors import InputError

if TYPE_CHECKING:
    from exposight.paper.result.datasets import Dataset
    from exposight.paper.result.finding import Finding
    from exposight.paper.result.rungs import TrainedRung
    from exposight.paper.result.settings import StudySettings
    from exposight.paper.result.statistics import DependenceMatrix, LearningCurve
    from exposight.paper.result.table_rows import StudyTables


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """Everything a report of the study needs.

    Parameters
    ----------
    settings : StudySettings
        What was asked for.
    exposight_version : str
        The program.
    campaigns : tuple of str
        What was measured, one line for each campaign: its name, views, captures, and whether it
        was simulated or recorded, and which share of the views of the full study it has.
    datasets : tuple of Dataset
        In the order of Table 9.
    rungs : tuple of TrainedRung
        In the order of the paper's tables.
    tables : StudyTables
        Tables 2, 3, 4, 5, 6, 8, 9.
    dependence : tuple of DependenceMatrix
        One for each sensor (Fig. 20 and its counterpart).
    learning_curves : tuple of LearningCurve
        Figs. 22 and 23, structured light only.
    findings : tuple of Finding
        In the paper's order.
    """

    settings: StudySettings
    exposight_version: str
    campaigns: tuple[str, ...]
    datasets: tuple[Dataset, ...]
    rungs: tuple[TrainedRung, ...]
    tables: StudyTables
    dependence: tuple[DependenceMatrix, ...]
    learning_curves: tuple[LearningCurve, ...]
    findings: tuple[Finding, ...]

    def dataset(self, name: str) -> Dataset:
        """Return a dataset by name.

        Raises
        ------
        InputError
            If the study has none of this name.
        """
        for dataset in self.datasets:
            if dataset.name == name:
                return dataset
        known = ", ".join(dataset.name for dataset in self.datasets)
        msg = f"the study has no dataset {name!r}; it has {known}"
        raise InputError(msg)

    def rung(self, name: str) -> TrainedRung:
        """Return a trained rung by name.

        Raises
        ------
        InputError
            If the study has none of this name.
        """
        for trained in self.rungs:
            if trained.rung.name == name:
                return trained
        known = ", ".join(trained.rung.name for trained in self.rungs)
        msg = f"the study has no rung {name!r}; it has {known}"
        raise InputError(msg)

"""An exposure plan taken as it is: what the closed loop is compared with."""

from __future__ import annotations

from exposight.observing import ObservationTable
from exposight.planning import ExposurePlan
from exposight.planning.loop_report import Outcome, OutcomeStatus, Request
from exposight.planning.recommendation import FeatureOutlook
from exposight.tables import number


class OpenLoop:
    """Asks for a plan's captures in their order, whatever they show (`Loop`).

    Parameters
    ----------
    plan : ExposurePlan
    """

    def __init__(self, plan: ExposurePlan) -> None:
        self._plan = plan
        aims: dict[tuple[str, float], list[str]] = {}
        for feature in plan.features:
            if feature.view is not None and feature.exposure_ms is not None:
                aims.setdefault((feature.view, feature.exposure_ms), []).append(feature.feature)
        self._requests = [
            Request(
                view=view.name,
                camera_from_part=view.camera_from_part,
                exposure_ms=exposure.exposure_ms,
                set_value=exposure.set_value,
                set_unit=exposure.set_unit,
                features=tuple(aims.get((view.name, exposure.exposure_ms), ())),
                expected=0.0,
                why=f"{view.name}, as planned: {number(exposure.exposure_ms)} ms",
            )
            for view in plan.views
            for exposure in view.exposures
        ]
        self._best: dict[str, tuple[float, str, float]] = {}
        self._tries: dict[str, int] = {}

    def next(self) -> Request | None:
        """Return the next capture of the plan; None after the last."""
        return self._requests[0] if self._requests else None

    def took(self, rows: ObservationTable) -> str:
        """Take note of what one capture gave, and say so in a line."""
        view, exposure_ms = str(rows.frame["view"][0]), float(rows.frame["exposure_ms"][0])
        asked = [each for each in self._requests if each.view == view]
        if asked:
            self._requests.remove(min(asked, key=lambda each: abs(each.exposure_ms - exposure_ms)))
        need, got = self._plan.target_p_norm, []
        for name, p_norm in rows.measured().frame.select("feature", "p_norm").iter_rows():
            best = self._best.get(name)
            if best is None or p_norm > best[0]:
                self._best[name] = (p_norm, view, exposure_ms)
            if best is None or best[0] < need:  # not had before
                self._tries[name] = self._tries.get(name, 0) + 1
                got += [name] * (p_norm >= need)
        return f"{view}, {number(exposure_ms)} ms: got {', '.join(got) or 'nothing new'}"

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """What has become of each feature so far."""
        return tuple(map(self._outcome, self._plan.features))

    def _outcome(self, feature: FeatureOutlook) -> Outcome:
        p_norm, view, exposure_ms = self._best.get(feature.feature, (None, None, None))
        need, reason = self._plan.target_p_norm, ""
        status: OutcomeStatus = "open" if self._requests else "given up"
        if p_norm is not None and p_norm >= need:
            status = "had"
        elif status == "given up":
            best = "was not measured" if p_norm is None else f"reached {p_norm:.2f}"
            reason = feature.reason or f"it {best}, {need:g} is needed"
        return Outcome(
            feature=feature.feature,
            status=status,
            p_norm=p_norm,
            view=view,
            exposure_ms=exposure_ms,
            tries=self._tries.get(feature.feature, 0),
            promised=feature.chance,
            reason=reason,
        )

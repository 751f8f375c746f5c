"""The measurements of a study beside a run's summary, by the names in the study's `measure`.

onboard       time of the craft's computers (`swarm.studies.campaign.onboard_cost`)
central       a central solver in their place (`swarm.studies.campaign.central_cost`)
bound         the posterior Cramer-Rao bound (`swarm.studies.campaign.posterior_bound`)
first_craft   the summary's figures of craft 0 alone
"""

from collections.abc import Collection
from typing import Any

from swarm.flight.flight import Flight
from swarm.results.period import Period
from swarm.scenario import Scenario
from swarm.studies.campaign.central_cost import CentralCost
from swarm.studies.campaign.onboard_cost import OnboardCost
from swarm.studies.campaign.posterior_bound import PosteriorBound

Metrics = dict[str, Any]


class Instruments:
    """The observer of one flight; `metrics` returns what was found. Wall-clock figures end in `_us`."""

    def __init__(self, scenario: Scenario, measure: Collection[str]) -> None:
        """Prepare to measure what `measure` names."""
        self._scenario, self._measure = scenario, measure
        self._photodiodes = 0.0
        self._onboard: OnboardCost | None = None
        self._central: CentralCost | None = None
        self._bound: PosteriorBound | None = None

    def begin(self, flight: Flight) -> None:
        """See the flight before its first period."""
        self._photodiodes = float(flight.sensors.lighthouse.photodiodes.present.sum(axis=1).mean())
        if "onboard" in self._measure:
            self._onboard = OnboardCost(self._scenario, flight)
        if "central" in self._measure:
            self._central = CentralCost(self._scenario, flight.world.photodiodes)
        if "bound" in self._measure:
            self._bound = PosteriorBound(self._scenario, flight)

    def period(self, period: Period) -> None:
        """See one period at its epoch."""
        for instrument in (self._central, self._bound):
            if instrument is not None:
                instrument.period(period)

    def metrics(self, summary: Metrics) -> Metrics:
        """Return figures by name, with units in the names; None where there is nothing to say. summary: the run's."""
        swarm = summary.get("swarm") or {}
        visible = swarm.get("mean_visible")
        out: Metrics = {"lit_share": None if visible is None else visible / self._photodiodes}
        if "first_craft" in self._measure:
            first: Metrics = next(iter(summary.get("craft", {}).values()), {})
            visible = first.get("mean_visible")
            out["first_craft_lit_share"] = None if visible is None else visible / self._photodiodes
            for name in ("tracking_share", "ekf_position_rms_m", "ekf_attitude_rms_deg"):
                out[f"first_craft_{name}"] = first.get(name)
            out["first_craft_nees_mean"] = (first.get("nees") or {}).get("mean")
        for instrument in (self._onboard, self._central, self._bound):
            out |= {} if instrument is None else instrument.metrics()
        return out

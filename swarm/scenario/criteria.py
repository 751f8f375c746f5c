"""The `[[criteria]]` tables of a scenario: conditions for the success of its run. See docs/criteria.md."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.scenario.limits import ANY_FIGURE, SPAN
from swarm.scenario.table import Mistake, Table, Time
from swarm.units import split_unit

Statistic = Literal["rms", "mean", "max", "min", "sum", "last", "at_contact"]


class Criterion(Table):
    """A figure of the run, computed from its telemetry, must lie within limits, ends included."""

    measure: str = Field(
        description="Measured quantity: a column of the telemetry with numbers or with true and false, or contacts, "
        "tracking_share, longest_blind_s, separation_m."
    )
    statistic: Statistic = Field(
        default="max",
        description="Statistic of the column: over all its values, or each craft's last value, or its last value "
        "before contact.",
    )
    min: Annotated[float | None, ANY_FIGURE] = Field(
        default=None, ge=-1e9, le=1e9, description="Lower limit. Unset: none."
    )
    max: Annotated[float | None, ANY_FIGURE] = Field(
        default=None, ge=-1e9, le=1e9, description="Upper limit. Unset: none."
    )
    craft: Annotated[tuple[str, ...], Strict(False)] = Field(
        default=(), description="Names of the craft that the criterion is about. Empty: all."
    )
    from_s: Time = Field(default=0.0, description="Time from which the telemetry counts.")
    to_s: Annotated[float | None, SPAN] = Field(
        default=None, ge=1e-3, le=86400, description="Time until which the telemetry counts. Unset: the end."
    )
    name: str | None = Field(
        default=None,
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_]*$",
        max_length=64,
        description="Name of the criterion in reports and studies. Unset: measure and statistic.",
    )

    @property
    def label(self) -> str:
        """The name of the criterion, the unit last."""
        if self.name is not None:
            return self.name
        if self.measure in NAMED or self.statistic == "max":
            return self.measure
        stem, _ = split_unit(self.measure)
        return f"{stem}_{self.statistic}{self.measure.removeprefix(stem)}"

    def between_keys(self) -> Iterator[Mistake]:
        """Require a limit, and limits with something between them."""
        if self.min is None and self.max is None:
            yield "needs a limit: set max, or min, or both", "max", "min"
        elif self.min is not None and self.max is not None and self.min > self.max:
            yield f"must be at most max = {self.max:g}", "min", "max"
        if self.to_s is not None and self.to_s <= self.from_s:
            yield f"must be after from_s = {self.from_s} s", "to_s", "from_s"


NAMED = ("contacts", "tracking_share", "longest_blind_s", "separation_m")
"""Measures that are no column: periods in contact, share of the rows that track, the longest time without a pose after
the first one, the least distance between the bodies' origins of two craft."""

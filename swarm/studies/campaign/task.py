"""One run of a study, as a pure function of small arguments: the work of a worker, wherever it is.

    Order -> fly -> Row     (parameters, seed, metrics with units in their names, status, reason, seconds)

Nothing is left on the worker: the run's folder is temporary, and its telemetry, where it is wanted, comes back as the
bytes of its Parquet file. A run that cannot be flown is a row too, with the reason.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

from swarm.errors import SwarmError
from swarm.scenario import Scenario
from swarm.units import split_unit
from swarm.version import VERSION

COMPLETE, FAILED, LOST = "complete", "failed", "lost"
"""Status of a row. failed: the run cannot be flown, and never could. lost: it could perhaps be, by another worker."""
HEAD = ("run", "key", "status", "reason", "seed")
SECONDS = "seconds"


@dataclass(frozen=True)
class Order:
    """The order to fly one run, complete for any worker.

    scenario: a `Scenario` as `model_dump` gives it. version: the program's version that may fly it.
    """

    number: int
    key: str
    scenario: dict[str, Any]
    measure: tuple[str, ...] = ()
    telemetry: bool = False
    version: str = VERSION


class Flown(NamedTuple):
    """The end of an order. metrics: figures by name. telemetry: a Parquet file, where it was ordered."""

    number: int
    key: str
    status: str
    reason: str
    seconds: float
    metrics: dict[str, Any]
    telemetry: bytes | None = None


def fly(order: Order) -> Flown:
    """Fly one run; never raises but for what ends the program."""
    began = perf_counter()
    metrics: dict[str, Any] = {}
    telemetry: bytes | None = None
    status, reason = COMPLETE, ""
    try:
        if order.version != VERSION:
            status, reason = LOST, f"a worker has lighthouse-swarm {VERSION}, the study {order.version}"
        else:
            metrics, telemetry = _fly(order)
    except SwarmError as error:
        status, reason = FAILED, str(error)
    except Exception as error:  # a defect of one run must not end the others
        status, reason = FAILED, f"{type(error).__name__}: {error}"
    return Flown(order.number, order.key, status, reason, perf_counter() - began, metrics, telemetry)


def _fly(order: Order) -> tuple[dict[str, Any], bytes | None]:
    from swarm.flight.simulate import simulate
    from swarm.studies.campaign.measures import Instruments

    scenario = Scenario.model_validate(order.scenario)
    # The folder goes when the run ends: nobody will smooth it.
    scenario = scenario.model_copy(update={"recording": scenario.recording.model_copy(update={"filter": False})})
    instruments = Instruments(scenario, order.measure)
    with TemporaryDirectory(prefix="swarm-") as place:
        run = simulate(scenario, out=Path(place) / "run", record=False, observer=instruments)
        telemetry = (run.folder / "telemetry.parquet").read_bytes() if order.telemetry else None
    summary = run.summary
    head = {"periods": summary["periods"], "flown_s": summary["duration_s"], "craft_count": summary["craft_count"]}
    metrics = {**head, **dict(_flat(summary["swarm"])), **_criteria(summary), **instruments.metrics(summary)}
    return metrics, telemetry


def _criteria(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return whether all criteria held, which did not, and the value of each."""
    verdicts = summary.get("criteria")
    if not verdicts:
        return {}
    missed = ", ".join(verdict["name"] for verdict in verdicts if verdict["held"] is False)
    figures = {f"criterion_{verdict['name']}": verdict["value"] for verdict in verdicts}
    return {"criteria_held": summary["criteria_held"], "criteria_missed": missed, **figures}


def _flat(figures: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested figures as columns: `nees_mean`; of three numbers, one column per axis, before the unit."""
    for key, value in figures.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}_")
        elif isinstance(value, list):
            stem, _ = split_unit(name)
            for axis, component in zip("xyz", value, strict=True):
                yield f"{stem}_{axis}{name[len(stem) :]}", component
        else:
            yield name, value


def is_wall_clock(column: str) -> bool:
    """Tell whether a column holds a duration: only these differ between two runs of the same."""
    return column == SECONDS or column.endswith("_us")

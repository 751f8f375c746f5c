"""The command `swarm check`: a scenario, read and completed but not flown, and what it makes of each craft."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from swarm.cli.options import Overrides, Scenario, Seed
from swarm.cli.terminal import mistakes

if TYPE_CHECKING:
    from estimators.arrays import Floats
    from swarm.flight.craft_facts import CraftFacts


def check(scenario: Scenario, overrides: Overrides = None, seed: Seed = None) -> None:
    """Check a scenario, and print it with every default.

    \b
    swarm check my/scenario.toml
    swarm check formation --set swarm.count=16 > mine.toml
    """
    with mistakes():
        from rich.console import Console

        from swarm.flight import builders
        from swarm.flight.craft_facts import facts, out_of_light
        from swarm.flight.flight import Flight
        from swarm.report.findings import names
        from swarm.scenario import load, to_toml
        from swarm.scenario.faults import too_late
        from swarm.tables import say

        settings = load(scenario, overrides or (), seed)
        flight = Flight(settings)
        if settings.criteria:
            from swarm.flight.scene import scene
            from swarm.results.run_writer import check_criteria

            check_criteria(settings, scene(settings, flight))
        typer.echo(to_toml(settings), nl=False)
        sys.stdout.flush()
        _report(facts(settings, flight))
        console = Console(stderr=True)
        say(console, f"{'warning' if flight.steps.too_few else 'note'}: {flight.steps.sentence()}")
        for note in (*out_of_light(settings, flight), *too_late(settings.fault, settings.duration_s)):
            say(console, f"note: {note}")
        if flat := builders.flat_craft(settings, flight.sensors.lighthouse.photodiodes):
            say(
                console,
                f"note: every photodiode of {names(flat)} lies in one plane, whose mirror image about the line of sight"
                " fits nearly as well: small, far or face-on the pose is ambiguous at the start (docs/filter.md)",
            )
        if sys.stdout.isatty():
            typer.echo(
                f"\n{scenario} is right: {len(settings.craft_names)} craft, {settings.duration_s:g} s.", err=True
            )


def _report(craft: "Sequence[CraftFacts]") -> None:
    """Print what the scenario makes of each craft, beside the scenario itself: to standard error."""
    from rich.text import Text

    from swarm.tables import RankedColumn, fitting, say, wide_console

    console = wide_console(stderr=True, highlight=False)
    columns = [
        RankedColumn(0, "craft", [_names(each.names) for each in craft]),
        RankedColumn(3, "mass\nkg", [f"{each.mass_kg:.4g}" for each in craft]),
        RankedColumn(1, "photo-\ndiodes", [str(each.photodiodes) for each in craft]),
        RankedColumn(4, "cam-\neras", [str(each.cameras) for each in craft]),
        RankedColumn(6, "force, mN\nx / y / z", [_axes(each.force_n, 1e3) for each in craft]),
        RankedColumn(2, "acceleration, mm/s²\nx / y / z", [_axes(each.acceleration_m_s2, 1e3) for each in craft]),
        RankedColumn(5, "torque, mN m\nx / y / z", [_axes(each.torque_nm, 1e3) for each in craft]),
    ]
    made, left_out = fitting(console.width, columns)
    console.print()
    console.print(made)
    if left_out:
        console.print(Text(f"No room in {console.width} columns for: {left_out}.", "dim"))
    for each in craft:
        for warning in each.warnings():
            say(console, Text.assemble(("warning: ", "bold yellow"), warning))


def _names(names: "Sequence[str]") -> str:
    return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}"


def _axes(values: "Floats | None", scale: float) -> str:
    return "ideal" if values is None else " / ".join(f"{scale * value:.3g}" for value in values)

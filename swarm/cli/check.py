"""The command `swarm check`: a scenario, read and completed but not flown."""

import sys

import typer

from swarm.cli.options import Overrides, Scenario, Seed
from swarm.cli.terminal import mistakes


def check(scenario: Scenario, overrides: Overrides = None, seed: Seed = None) -> None:
    """Check a scenario, and print it with every default.

    \b
    swarm check my/scenario.toml
    swarm check formation --set swarm.count=16 > mine.toml
    """
    with mistakes():
        from swarm.flight import builders
        from swarm.report.findings import names
        from swarm.scenario import load, to_toml

        settings = load(scenario, overrides or (), seed)
        flat = builders.check(settings)
        if settings.criteria:
            from swarm.flight.flight import Flight
            from swarm.flight.scene import scene
            from swarm.results.run_writer import check_criteria

            check_criteria(settings, scene(settings, Flight(settings)))
        typer.echo(to_toml(settings), nl=False)
        if flat:
            typer.echo(
                f"note: every photodiode of {names(flat)} lies in one plane, whose mirror image about the line of sight"
                " fits nearly as well: small, far or face-on the pose is ambiguous at the start (docs/filter.md)",
                err=True,
            )
        if sys.stdout.isatty():
            typer.echo(
                f"\n{scenario} is right: {len(settings.craft_names)} craft, {settings.duration_s:g} s.", err=True
            )

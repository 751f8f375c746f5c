"""The command `swarm`: parsing and printing, nothing else. Everything heavy is imported by the command that uses it.

Exit codes: 0 done, 2 a mistake of the user (one message, no traceback), 128 + n stopped by signal n (130: Ctrl-C).
"""

import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm import calibrate_command, layout_command, study_commands
from swarm.errors import SwarmError
from swarm.terminal import experiment_and_report, fly_and_report, mistakes, stoppable

if TYPE_CHECKING:
    from swarm.results.progress import Progress
    from swarm.results.run_folder import Run

HELP = """Fly a swarm of spacecraft in front of one laser lighthouse; each craft finds its own pose.

Begin with:

\b
  swarm list                   what there is to fly
  swarm run formation          eight craft on a ring, 30 s
  swarm view runs/formation-7  look at it, in the viewer
  swarm check my.toml          is my own scenario right?
  swarm run my.toml --set swarm.count=16 --seed 3
  swarm study scaling          many runs, on all cores
  swarm report runs/scaling    one HTML page of them
  swarm reproduce              the papers' experiments

A run leaves a folder: recording.rrd for the viewer,
telemetry.parquet with a row per craft and period,
summary.json, and scenario.toml to repeat it.
From Python: import swarm; swarm.simulate(swarm.load("formation"))
"""

app = typer.Typer(
    name="swarm",
    help=HELP,
    epilog="swarm COMMAND --help explains each with an example. Scenario files: docs/scenario.md.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


class Source(StrEnum):
    """What of a recording the on-board code is fed with."""

    PULSES = "pulses"
    ANGLES = "angles"


Scenario = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name that `swarm list` shows, or the path of a .toml file.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value, such as swarm.count=16. Repeatable."),
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Replace the scenario's seed.")]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="FOLDER", help="Where to write; else runs/<scenario>-<seed>.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace a run that is there already.")]
Size = Annotated[int | None, typer.Option(metavar="N", help="A smaller, quicker form; see the list.")]
NoRecording = Annotated[bool, typer.Option("--no-recording", help="Write no recording for the viewer.")]


def main() -> int:
    """Run the command line; the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A terminal without Unicode shows '?' instead of failing.
            stream.reconfigure(errors="replace")
    try:
        app(prog_name="swarm")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(bool(end.code))
    return 0


def _version(wanted: bool) -> None:
    if wanted:
        from swarm import __version__

        typer.echo(f"swarm {__version__}")
        raise typer.Exit


@app.callback()
def _swarm(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@app.command("list")
def list_() -> None:
    """Show the scenarios, studies and craft models there are."""
    with mistakes():
        import tomllib
        from shutil import get_terminal_size

        from swarm.assets import models, scenarios, studies

        lines: list[str] = []
        for head, files in (("Scenarios: swarm run NAME", scenarios()), ("Studies: swarm study NAME", studies())):
            about = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in files.items()}
            lines += [*([""] if lines else []), head]
            lines += [f"  {name:<17} {table.get('description', '')}" for name, table in about.items()]
        lines += ["", 'Craft: model = "NAME" in a scenario']
        lines += [f"  {name:<17} {_first_sentence(path.with_name('README.md'))}" for name, path in models().items()]
        width = get_terminal_size().columns if sys.stdout.isatty() else 1000
        for line in lines:
            typer.echo(line.rstrip() if len(line) <= width else f"{line[: width - 1]}…")


@app.command()
def run(
    scenario: Scenario,
    overrides: Overrides = None,
    seed: Seed = None,
    out: Out = None,
    force: Force = False,
    live: Annotated[bool, typer.Option("--live", help="Open the viewer and watch while it flies.")] = False,
    no_recording: NoRecording = False,
    calibration: Annotated[
        Path | None,
        typer.Option("--calibration", metavar="FILE", help="What the craft remove on board: of `swarm calibrate`."),
    ] = None,
) -> None:
    """Fly a scenario, and write what happened.

    \b
    swarm run formation
    swarm run formation --set swarm.count=16 \\
        --set lighthouse.angle_noise_arcsec=20 --seed 3
    swarm run my/scenario.toml --live --out runs/mine
    """
    with mistakes():
        from swarm.scenario import load
        from swarm.scenario.text import toml_value

        also = [] if calibration is None else [f"navigation.calibration={toml_value(str(calibration))}"]
        settings = load(scenario, [*(overrides or ()), *also], seed)
        folder = out or _default_folder(settings.name, settings.seed)

        def fly(progress: Callable[["Progress"], None]) -> "Run":
            from swarm.simulate import simulate

            return simulate(settings, out=folder, force=force, live=live, record=not no_recording, progress=progress)

        fly_and_report(settings.name, folder, fly)


@app.command()
def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run, or a .rrd file.")],
    web: Annotated[bool, typer.Option("--web", help="In the browser, served to this machine only.")] = False,
) -> None:
    """Open a run's recording in the viewer.

    \b
    swarm view runs/formation-7
    swarm view runs/formation-7 --web
    """
    with mistakes():
        from swarm.results.run_folder import open_run
        from swarm.results.viewer import view as open_viewer

        recording = run if run.suffix == ".rrd" else open_run(run).recording
        if recording is None:
            raise SwarmError(f"{run} has no recording: it was flown with --no-recording, or recording.enabled = false")
        with stoppable():
            code = open_viewer(recording, web=web)
        raise typer.Exit(code)


@app.command()
def check(scenario: Scenario, overrides: Overrides = None, seed: Seed = None) -> None:
    """Check a scenario; print it with every default.

    \b
    swarm check my/scenario.toml
    swarm check formation --set swarm.count=16 > mine.toml
    """
    with mistakes():
        from swarm import build
        from swarm.scenario import load, to_toml

        settings = load(scenario, overrides or (), seed)
        build.check(settings)
        typer.echo(to_toml(settings), nl=False)
        if sys.stdout.isatty():
            typer.echo(
                f"\n{scenario} is right: {len(settings.craft_names)} craft, {settings.duration_s:g} s.", err=True
            )


@app.command()
def replay(
    recording: Annotated[
        Path,
        typer.Argument(metavar="RECORDING", help="A recording of a real lighthouse: libsurvive's .rec or .rec.gz."),
    ],
    object_name: Annotated[
        str | None, typer.Option("--object", metavar="NAME", help="The tracked object, such as HMD.")
    ] = None,
    lighthouse: Annotated[
        int, typer.Option("--lighthouse", metavar="N", min=0, help="The station that is the reference.")
    ] = 0,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration", metavar="FILE", help="The station's errors: libsurvive's config, or ours (TOML)."
        ),
    ] = None,
    source: Annotated[
        Source, typer.Option("--from", help="Raw light pulses, or the angles that the recording computed of them.")
    ] = Source.PULSES,
    overrides: Overrides = None,
    seed: Seed = None,
    out: Out = None,
    force: Force = False,
    no_recording: NoRecording = False,
) -> None:
    """Feed a real recording to the same on-board code.

    \b
    swarm replay walk.rec.gz --object HMD --lighthouse 0 \\
        --calibration config.json
    swarm replay walk.rec.gz --object HMD --from angles \\
        --set navigation.motion_compensation=false
    """
    with mistakes():
        from swarm.scenario import for_replay

        settings = for_replay(recording, overrides or (), seed)
        folder = out or _default_folder(settings.name, settings.seed)

        def fly(progress: Callable[["Progress"], None]) -> "Run":
            from swarm.replay import replay as fly_again

            return fly_again(
                recording,
                object_name=object_name,
                lighthouse=lighthouse,
                calibration=calibration,
                source=source.value,
                scenario=settings,
                out=folder,
                force=force,
                record=not no_recording,
                progress=progress,
            )

        fly_and_report(settings.name, folder, fly)


@app.command()
def reproduce(
    experiment: Annotated[
        str | None, typer.Argument(metavar="EXPERIMENT", help="One of those that are listed without it.")
    ] = None,
    poses: Size = None,
    frames: Size = None,
    runs: Size = None,
    seconds: Size = None,
    draws: Size = None,
    seed: Annotated[int | None, typer.Option("--seed", metavar="N", help="Replace the experiment's seed.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Where to write; else runs/<experiment>-<seed>.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an experiment that is there already.")] = False,
) -> None:
    """Do a paper's experiment again: its table beside ours.

    \b
    swarm reproduce
    swarm reproduce lighthouse-static
    swarm reproduce lighthouse-static --poses 5 --frames 300

    Without EXPERIMENT, list them, with what makes each smaller.
    It leaves data.parquet, figure.png, figure.svg, comparison.json.
    """
    with mistakes():
        from swarm.experiments import EXPERIMENTS

        if experiment is None:
            for name, known in EXPERIMENTS.items():
                sizes = " ".join(f"--{size} {value}" for size, value in known.sizes.items())
                typer.echo(f"swarm reproduce {name}")
                typer.echo(f"  {known.source}, {known.figure}: {known.about}")
                typer.echo(f"  {sizes}")
            return
        asked = {"poses": poses, "frames": frames, "runs": runs, "seconds": seconds, "draws": draws}
        sizes_asked = {size: value for size, value in asked.items() if value is not None}
        experiment_and_report(experiment, out=out, force=force, seed=seed, sizes=sizes_asked)


app.command()(calibrate_command.calibrate)
app.command()(layout_command.layout)
app.command()(study_commands.study)
app.command()(study_commands.report)


def _first_sentence(readme: Path) -> str:
    """What a model is, from the text below its README's title; empty if it has none."""
    if not readme.is_file():
        return ""
    paragraphs = readme.read_text(encoding="utf-8").split("\n\n")
    text = next((p for p in paragraphs if p.strip() and not p.startswith("#")), "")
    return " ".join(text.split()).partition(". ")[0].removesuffix(".")


def _default_folder(name: str, seed: int) -> Path:
    return Path("runs") / f"{name}-{seed}"

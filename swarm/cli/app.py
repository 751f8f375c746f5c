"""The program `swarm`: its commands, put together. Everything heavy is imported by the command that uses it.

Exit codes: 0 done, 1 done but a criterion of the scenario did not hold or a run of a study failed, 2 a mistake of the
user (one message, no traceback), 128 + n stopped by signal n (130: Ctrl-C; 141: the reader of the output has gone).
"""

import logging
import os
import signal
import sys
from typing import Annotated

import typer
from typer.main import get_command

from swarm.cli.calibrate import calibrate
from swarm.cli.check import check
from swarm.cli.compare import compare
from swarm.cli.docs import docs
from swarm.cli.export import export
from swarm.cli.layout import layout
from swarm.cli.list import list_all
from swarm.cli.new import new
from swarm.cli.place import place
from swarm.cli.replay import replay
from swarm.cli.report import report
from swarm.cli.reproduce import reproduce
from swarm.cli.run import run
from swarm.cli.smooth import smooth
from swarm.cli.streams import ended_by_output, open_streams
from swarm.cli.study import study
from swarm.cli.survey import survey
from swarm.cli.terminal import Handler, error_message, stopping_once
from swarm.cli.usage import is_usage, usage_message
from swarm.cli.video import video
from swarm.cli.view import view
from swarm.cli.warm import warm
from swarm.errors import SwarmError
from swarm.user_text import check_text

HELP = """Fly a swarm of spacecraft in front of one laser lighthouse; each craft finds its own pose.

Begin with:

\b
  swarm list                   list what there is to fly
  swarm run formation          fly eight craft on a ring
  swarm view runs/formation-7  look at it in the viewer
  swarm new my                 write your own scenario
  swarm check my/my.toml       check it
  swarm run my/my.toml --set swarm.count=16 --seed 3
  swarm study scaling          fly many runs, on all cores
  swarm report runs/scaling    make an HTML page of them
  swarm reproduce              list papers' experiments

A run leaves a folder: recording.rrd for the viewer,
telemetry.parquet with a row per craft and period,
summary.json, and scenario.toml to repeat it.
From Python: import swarm; swarm.simulate("formation")
"""

app = typer.Typer(
    name="swarm",
    help=HELP,
    epilog="swarm COMMAND --help explains a command with an example. Scenario files: swarm docs scenario.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def main(outside: Handler = signal.default_int_handler) -> int:
    """Run the command line, and return the exit code. outside: handler of Ctrl-C before it and after it."""
    # Batches of small matrices: threads of the linear algebra only wait for each other, at twice the processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # It warns on standard error where the user's folder of settings cannot be made, which nothing here needs.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    with open_streams(), stopping_once(outside):
        try:
            try:
                for number, argument in enumerate(sys.argv[1:], start=1):
                    check_text(argument, f"argument {number}")
                ended = get_command(app).main(prog_name="swarm", standalone_mode=False)
            finally:
                sys.stdout.flush()
        except SwarmError as error:
            error_message(str(error))
            return 2
        except (SystemExit, OSError) as end:
            code = ended_by_output(end)
            if code is not None:
                return code
            if isinstance(end, OSError):
                if end.filename is None:
                    raise
                # Such as a shell's settings, where a completion cannot be installed.
                error_message(f"{end.filename}: {end.strerror}")
                return 2
            return end.code if isinstance(end.code, int) else int(bool(end.code))
        except typer.Abort:
            return 128 + signal.SIGINT
        except Exception as error:
            if not is_usage(error):
                raise
            if type(error).__name__ == "NoArgsIsHelpError":
                print(error, file=sys.stderr)  # noqa: T201
            else:
                error_message(usage_message(error, sys.argv[1:]))
            return 2
    return ended if isinstance(ended, int) else 0


def _version(wanted: bool) -> None:
    if wanted:
        from swarm.version import VERSION

        typer.echo(f"swarm {VERSION}")
        raise typer.Exit


@app.callback()
def _swarm(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


app.command("list")(list_all)
flying = (run, new, view, check, replay, smooth, reproduce, calibrate, survey, layout, place, study)
afterwards = (report, compare, export, video, docs, warm)
for command in (*flying, *afterwards):
    app.command()(command)

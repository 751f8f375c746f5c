"""`swarm layout` from request to files: search, judge against the shipped and the even layouts, write.

A layout leaves, beside each other: the craft's MJCF, and with `-layout` in their names the figures (JSON) and the
picture (PNG and SVG).
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimators.lighthouse.pnp import FEWEST_LIT
from swarm.errors import SwarmError
from swarm.figures import save
from swarm.results.disk import outputs, refuse_existing
from swarm.studies.design.even import even_spreads
from swarm.studies.layout import judgement
from swarm.studies.layout.figure import draw
from swarm.studies.layout.judgement import Judged, judge
from swarm.studies.layout.prediction import Task
from swarm.studies.layout.refusal import refuse_too_few, refuse_unsolved
from swarm.studies.layout.report import figures
from swarm.studies.layout.request import Request, checked, in_scene
from swarm.studies.layout.search import find, places
from swarm.studies.layout.smallest import smallest
from swarm.world.craft import load_craft
from swarm.world.hull import Mount
from swarm.world.refit import refit

EVENS = 24
"""Even spreads, from as many first photodiodes."""
GRID_M = 1e-5
"""Positions are rounded to so much: what is judged is what the file says [m]."""
DESIGNED, SHIPPED, EVEN = "designed", "shipped", "even"


class Study(NamedTuple):
    """A layout that was found and written: figures as in the JSON, and the files."""

    figures: dict[str, Any]
    files: tuple[Path, ...]


def files_of(out: Path) -> tuple[Path, ...]:
    """Return the files of the model, the figures and the pictures of a layout that is written as `out`."""
    return (out, *(out.with_name(f"{out.stem}-layout{suffix}") for suffix in (".json", ".png", ".svg")))


def default_out(request: Request, model: Path) -> Path:
    """Return where a layout goes if the user does not say."""
    return Path("runs") / f"layout-{model.stem}-{request.photodiodes or 'smallest'}" / model.name


def study(request: Request, out: Path | None, force: bool, say: Callable[[str], None], seed: int = 0) -> Study:
    """Find a layout and write it.

    Args:
        request: What the user asks for.
        out: File of the new model; default: below runs/.
        force: Replace files that are there.
        say: Is told what is going on.
        seed: Seed of the search.

    Raises:
        SwarmError: Something is wrong, or no layout keeps every pose solvable with one photodiode lost; nothing is
            written then.
    """
    asked, settings = checked(request)
    model = asked.hull.path
    out = default_out(request, model) if out is None else out
    files = files_of(out)
    _check_target(out, model, files, force)
    if request.scene is not None:
        say(f"flying {request.scene} by the truth")
        asked = in_scene(asked, settings, request.craft)

    say("places on the hull")
    at = places(asked)
    count = request.photodiodes
    least = refuse_too_few(asked, at, count) if asked.losses else FEWEST_LIT
    if count is None:
        count = smallest(asked, at, least, request.attitude_deg, request.position_mm, say)
    say(f"{count} photodiodes among {len(at.coarse.point_m)} places, at {len(at.poses.position)} poses")
    mount = tidy(find(asked, at, count, seed=seed).mount)

    say("predicting and measuring")
    evens = [at.fine.at(chosen) for chosen in even_spreads(at.fine.point_m, count, EVENS)]
    layouts = [(DESIGNED, mount), (EVEN, evens[0])]
    if len(asked.hull.shipped.point_m):
        layouts.append((SHIPPED, asked.hull.shipped))
    others = [(f"{EVEN} {i}", other) for i, other in enumerate(evens[1:], start=1)]
    judged = judge(asked, layouts + others, [name for name, _ in layouts])
    if asked.losses:
        refuse_unsolved(asked, judged[0], least)
    made = figures(request.filled(), asked, judged)
    _write(files, model, mount, made, judged, asked)
    return Study(made, files)


def tidy(mount: Mount) -> Mount:
    """Return the photodiodes in order, front faces first, then around the craft, at rounded positions."""
    azimuth = np.arctan2(mount.point_m[:, 1], mount.point_m[:, 0])
    order = np.lexsort((azimuth, -mount.normal[:, 2].round(3)))
    sorted_ = mount.at(order)
    return Mount((sorted_.point_m / GRID_M).round() * GRID_M, sorted_.normal)


def _check_target(out: Path, model: Path, files: tuple[Path, ...], force: bool) -> None:
    if out.suffix != ".xml":
        raise SwarmError(f"--out {out}: the model's file must end in .xml")
    if out.resolve() == model.resolve():
        raise SwarmError(f"--out {out}: this is the model that the layout is designed for; choose another file")
    refuse_existing(*files, force=force)


def _write(
    files: tuple[Path, ...], model: Path, mount: Mount, made: dict[str, Any], judged: list[Judged], asked: Task
) -> None:
    about = f"{model.name} with {len(mount.point_m)} photodiodes placed by `swarm layout`"
    text, picture = refit(model, mount, files[0], about), draw(asked, judged, judgement.tried)
    with outputs(*files) as (out, numbers, *pictures):
        out.write_text(text, encoding="utf-8")
        load_craft(out)
        numbers.write_text(json.dumps(made, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        for path in pictures:
            save(picture, path)

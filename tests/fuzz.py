"""Hostile inputs in large numbers, each of them flown or replayed under a limit of memory and of processor time.

    nice python tests/fuzz.py --scenarios 30000 --recordings 1000

Every scenario mutant that is accepted is built as `swarm check` builds it, and every tenth is flown for two periods;
equal scenarios are built once. Every recording mutant is listed and replayed as a user does it. A traceback, a number
that is not finite in the truth, more than 1 GB of memory beyond that of the warm program, or more than 60 s of
processor time is printed with the mutant's number, which names it for good. Exit code 1 if there was any. `--first N`
begins at mutant N. About an hour on one core.
"""

import argparse
import contextlib
import faulthandler
import io
import json
import os
import resource
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import FrameType

import numpy as np
from made_recording import Made
from made_recording import lines as recording_lines
from mutants import FOREIGN, mutant, recording_mutant

from swarm.assets import scenarios
from swarm.cli import app
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.scenario import Scenario, load

MEMORY_BYTES = 2**30
PROCESSOR_S = 60.0
PERIODS = 2
MOST_CRAFT = 100
"""Largest swarm that is flown: larger ones are only read."""


class TooLong(Exception):
    """An input took more processor time than it may."""


def fly(settings: Scenario, periods: int = PERIODS) -> None:
    """Build a scenario as `swarm check` does, and fly it for some periods.

    Raises:
        SwarmError: It cannot be built.
        ArithmeticError: A true pose is not finite.
    """
    flight = Flight(settings)
    for frame in range(min(periods, flight.periods)):
        period = flight.period(frame)
        if period.truth is None or not all(np.isfinite(part).all() for part in period.truth):
            raise ArithmeticError("a true pose is not finite")


def of_scenarios(texts: Sequence[str], folder: Path) -> Callable[[int], str]:
    """Return the function that tries one scenario mutant."""
    built: set[str] = set()
    file = folder / "mutant.toml"

    def fault(number: int) -> str:
        file.write_bytes(mutant(texts, number).encode("utf-8", "surrogatepass"))
        try:
            settings = load(file)
            same = repr(settings.model_copy(update={"name": "", "description": ""}))
            if same not in built and len(settings.craft_names) <= MOST_CRAFT:
                built.add(same)
                fly(settings, 0 if number % 10 else PERIODS)
        except SwarmError as error:
            return f"the message is {str(error)[:200]!r}" if not str(error) or FOREIGN.search(str(error)) else ""
        return ""

    return fault


def recording_fault(data: bytes, folder: Path, arguments: tuple[str, ...]) -> str:
    """Return what is wrong with the answer of `swarm replay` to a recording, empty if nothing is."""
    file = folder / ("mutant.rec.gz" if data[:2] == b"\x1f\x8b" else "mutant.rec")
    file.write_bytes(data)
    said = io.StringIO()
    before = sys.argv
    sys.argv = ["swarm", "replay", str(file), *arguments]
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = app.main()
    finally:
        sys.argv = before
    text = said.getvalue()
    if code not in (0, 2) or "Traceback" in text or FOREIGN.search(text) or not text.strip():
        return f"exit code {code}: {text[-300:]!r}"
    return ""


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """Limit the memory and the processor time of the block."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TooLong(f"more than {PROCESSOR_S:.0f} s of processor time")

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES, before[1]))
    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, PROCESSOR_S)
    faulthandler.dump_traceback_later(1800, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, before)


def faults(
    count: range, fault: Callable[[int], str], limit: Callable[[], AbstractContextManager[None]] = limited
) -> Iterator[str]:
    """Yield a line for every mutant whose answer is wrong.

    Args:
        count: Numbers of the mutants.
        fault: Tries one of them, and says what is wrong with the answer.
        limit: The block in which each is tried.
    """
    for number in count:
        try:
            with limit():
                said = fault(number)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            said = f"{type(error).__name__}: {error!s:.200} at {place.filename}:{place.lineno}"
        if said:
            yield f"{number}: {said}"


def of_recordings(text: str, folder: Path) -> Callable[[int], str]:
    """Return the function that tries one recording mutant, listed and replayed from pulses or from angles."""

    def fault(number: int) -> str:
        data = recording_mutant(text, number)
        source = ("--from", "angles" if number % 2 else "pulses")
        flight = ("--out", str(folder / "run"), "--force", "--no-recording", *source)
        return recording_fault(data, folder, ("--list",)) or recording_fault(data, folder, flight)

    return fault


def main() -> int:
    """Try all, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", type=int, default=30_000)
    parser.add_argument("--recordings", type=int, default=1_000)
    parser.add_argument("--first", type=int, default=0)
    wanted = parser.parse_args()
    texts = [path.read_text() for path in scenarios().values()]
    found: dict[str, list[str]] = {"scenarios": [], "recordings": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path in scenarios().values():
            if len((settings := load(path)).craft_names) <= MOST_CRAFT:
                fly(settings)  # compiles, which is neither the mutants' time nor their memory
        recording = "\n".join(recording_lines(Made(duration_s=2.0)))
        if said := recording_fault(recording.encode(), folder, ("--out", str(folder / "run"), "--no-recording")):
            raise SystemExit(said)
        tries = {
            "scenarios": (wanted.scenarios, of_scenarios(texts, folder)),
            "recordings": (wanted.recordings, of_recordings(recording, folder)),
        }
        for kind, (count, fault) in tries.items():
            for line in faults(range(wanted.first, wanted.first + count), fault):
                print(kind, line, flush=True)
                found[kind].append(line)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(json.dumps({**{kind: len(lines) for kind, lines in found.items()}, "peak_gb": round(peak, 2)}))
    return 1 if any(found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())

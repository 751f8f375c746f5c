"""The plug-ins of docs/plug-ins.md, flown: the user's unscented filter beside the program's own, in the same light.

    python benchmarks/plug_ins.py [--seconds 10] [--out plug_ins.json]

Three craft on a ring steer by their own estimates and the page's controller, and their filters have one model of
motion; only the navigator differs. Times are of one core, the whole flight's per craft and period.
"""

import re
import tempfile
import time
from pathlib import Path
from typing import Any

from harness import finish, options, show

from swarm.flight.simulate import simulate
from swarm.scenario import load

PAGE = Path(__file__).parents[1] / "docs" / "plug-ins.md"
PERIODS_PER_S = 60
SCENARIO = """
duration_s = 10
seed = 3
[navigation]
quiet = { craft = "none" }
[swarm]
count = 3
feedback = "estimate"
controller = "spring.py:Spring"
motion = { kind = "ring", centre_m = [0, 0, 3], radius_m = 0.8 }
"""


def write_examples(folder: Path) -> None:
    """Write the classes of the page into files of their names."""
    for code in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        name = re.search(r"^class (\w+)", code, re.MULTILINE)
        assert name is not None
        (folder / f"{name[1].lower()}.py").write_text(code, encoding="utf-8")
    (folder / "mine.toml").write_text(SCENARIO, encoding="utf-8")


def flown(folder: Path, seconds: float, navigator: str | None) -> dict[str, Any]:
    """Return the figures of a flight with a navigator, None for the program's own."""
    changes: dict[str, Any] = {"duration_s": seconds}
    if navigator is not None:
        changes["swarm.navigator"] = str(folder / navigator)
    begin = time.process_time()
    run = simulate(load(folder / "mine.toml", changes), out=folder / "run", force=True, record=False)
    figures = run.summary["swarm"]
    return {
        "position_rms_mm": 1e3 * figures["ekf_position_rms_m"],
        "attitude_rms_deg": figures["ekf_attitude_rms_deg"],
        "nees": figures["nees"]["mean"],
        "nis": figures["nis"]["mean"],
        "tracking_share": figures["tracking_share"],
        "ms_a_step": 1e3 * (time.process_time() - begin) / (run.summary["craft_count"] * PERIODS_PER_S * seconds),
    }


def main() -> None:
    """Fly both and print."""
    asked = options(__doc__, seconds=(10.0, "length of the flights [s]"))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_examples(folder)
        flown(folder, 0.5, None)  # compiles
        result = {"ekf": flown(folder, asked.seconds, None), "ukf": flown(folder, asked.seconds, "ukf.py:Ukf")}
    show("Navigators", ("", *result["ekf"]), [(name, *figures.values()) for name, figures in result.items()])
    finish("plug_ins", result, asked.out)


if __name__ == "__main__":
    main()

"""How acquisition and tracking hold out: range noise, lines, half a panel missing, and other objects. As a table.

    PYTHONPATH=. python benchmarks/lidar_conditions.py [--attitudes 40] [--seed 0] [--json]

The satellite 5 m away at attitudes drawn over SO(3), the same for every row (`swarm.studies.papers.lidar`). Acquisition
is from nothing, tracking from a prediction 5 degrees and 5 cm off. "Half missing": the outer half of one panel is not
there, while the known shape has it. Right: within 2 degrees. Last, scans of crafts that are not the satellite, in its
place, with its shape as the one looked for: how many are taken for it.
"""

import argparse
import json
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.lidar.acquisition import acquire
from estimators.lidar.tracking import track
from swarm.assets import find_model
from swarm.studies.papers.lidar import SCANNER, Turntable, error_deg
from swarm.studies.papers.lidar_acquisition import random_rotations
from swarm.world.surface import known_shape

WHOLE = '<geom name="panel_right" class="panel" pos="0 1.05 0.1"'
HALF = '<geom name="panel_right" class="panel" size="0.35 0.25 0.0125" pos="0 0.8 0.1"'
TURN_DEG, SHIFT_M, RIGHT_DEG = 5.0, 0.05, 2.0
OTHERS = {"chaser": 3.0, "marker-target": 3.0, "cubesat6u": 1.0, "inspector": 1.0}
"""Other craft, and from how far they are scanned [m]."""


def broken(folder: Path) -> Path:
    """The satellite without the outer half of one panel."""
    model = find_model("satellite")
    text = model.read_text(encoding="utf-8")
    assert WHOLE in text
    changed = text.replace(WHOLE, HALF).replace('meshdir="assets"', f'meshdir="{model.parent / "assets"}"')
    path = folder / "broken.xml"
    path.write_text(changed, encoding="utf-8")
    return path


def row(bench: Turntable, truths: np.ndarray, rng: np.random.Generator) -> dict[str, Any]:
    """Acquisition and tracking of every attitude."""
    shape = known_shape(find_model("satellite"))
    acquired, tracked = [], []
    for truth in truths:
        scan = bench.scan(truth)
        found = acquire(scan, shape)
        acquired.append((float(error_deg(truth, found.rotation)), found.found))
        start = rot.exp(np.radians(rng.uniform(-TURN_DEG, TURN_DEG, 3)) / np.sqrt(3)) @ truth
        place = bench.position + rng.uniform(-SHIFT_M, SHIFT_M, 3) / np.sqrt(3)
        fit = track(scan, shape, start, place)
        tracked.append((float(error_deg(truth, fit.rotation)), fit.tracked))
    out: dict[str, Any] = {}
    for name, results in (("acquisition", acquired), ("tracking", tracked)):
        error, believed = np.array([e for e, _ in results]), np.array([b for _, b in results])
        right = error < RIGHT_DEG
        out[name] = {
            "right": float(right.mean()),
            "believed": float(believed.mean()),
            "wrong_and_believed": int(np.sum(believed & ~right)),
            "right_and_not_believed": int(np.sum(~believed & right)),
            "median_deg": float(np.median(error)),
            "95_percent_deg": float(np.quantile(error, 0.95)),
        }
    return out


def others(count: int, seed: int, rng: np.random.Generator) -> dict[str, Any]:
    """Scans of other craft: what acquisition says of them."""
    shape = known_shape(find_model("satellite"))
    out: dict[str, Any] = {}
    for name, distance_m in OTHERS.items():
        bench = Turntable(seed, name, SCANNER, distance_m)
        verdicts = [acquire(bench.scan(truth), shape).verdict.value for truth in random_rotations(count, rng)]
        out[name] = {word: verdicts.count(word) for word in sorted(set(verdicts))}
    return out


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attitudes", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    truths = random_rotations(given.attitudes, np.random.default_rng(given.seed))
    rows = []
    if not given.json:
        print("| noise | lines | panel | acquired right | believed wrong | median | 95 % | tracked | median | 95 % |")
        print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    with TemporaryDirectory() as folder:
        models = {"whole": find_model("satellite"), "half missing": broken(Path(folder))}
        for (panel, model), lines, noise_m in product(models.items(), (16, 32), (0.01, 0.03)):
            settings = SCANNER.model_copy(update={"lines": lines, "range_noise_mm": 1e3 * noise_m})
            found = row(Turntable(given.seed, model, settings), truths, np.random.default_rng(given.seed + 1))
            rows.append({"noise_m": noise_m, "lines": lines, "panel": panel} | found)
            a, t = found["acquisition"], found["tracking"]
            if not given.json:
                print(
                    f"| {100 * noise_m:g} cm | {lines} | {panel} | {100 * a['right']:.1f} % | "
                    f"{a['wrong_and_believed']} | {a['median_deg']:.2f}° | {a['95_percent_deg']:.2f}° | "
                    f"{100 * t['believed']:.1f} % | {t['median_deg']:.2f}° | {t['95_percent_deg']:.2f}° |",
                    flush=True,
                )
    strangers = others(given.attitudes, given.seed, np.random.default_rng(given.seed + 2))
    if given.json:
        print(json.dumps({"rows": rows, "others": strangers}, indent=2))
    else:
        print()
        for name, verdicts in strangers.items():
            print(f"{name}: " + ", ".join(f"{count} {word}" for word, count in verdicts.items()))


if __name__ == "__main__":
    main()

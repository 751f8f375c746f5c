"""Docstrings open as a sentence or a noun phrase, and a public function documents every one of many parameters."""

import ast
import re
from pathlib import Path

import pytest
from public_functions import Function, public_functions

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    path.relative_to(ROOT).as_posix() for room in ("swarm", "estimators") for path in (ROOT / room).rglob("*.py")
)
FRAGMENTS = {"What", "Where", "How", "Of", "Who", "Whether", "Why", "When"}
"""Words with which a clause begins that does not stand alone."""
COMMANDS = "swarm/cli/"
"""Functions here document their parameters in their options: the docstrings are the pages of `swarm COMMAND --help`."""

# Modules that are not done yet. The lists may only shrink.
ARGS_NOT_YET: frozenset[str] = frozenset(
    {
        "estimators/layout/error.py",
        "estimators/lighthouse/rows.py",
        "estimators/lighthouse/sweep.py",
        "estimators/rotation.py",
        "swarm/figures.py",
        "swarm/flight/builders/assembly.py",
        "swarm/flight/faults/injection.py",
        "swarm/flight/faults/schedule.py",
        "swarm/flight/recordings/calibration_file.py",
        "swarm/hardware.py",
        "swarm/onboard/acquisition.py",
        "swarm/onboard/actuation/allocation.py",
        "swarm/onboard/actuation/modulation.py",
        "swarm/onboard/actuation/orders.py",
        "swarm/onboard/ccd.py",
        "swarm/onboard/computer.py",
        "swarm/onboard/control.py",
        "swarm/onboard/flashes.py",
        "swarm/onboard/guidance/avoidance.py",
        "swarm/onboard/guidance/broadcast.py",
        "swarm/onboard/guidance/docking.py",
        "swarm/onboard/guidance/gains.py",
        "swarm/onboard/guidance/glideslope.py",
        "swarm/onboard/guidance/guidance.py",
        "swarm/onboard/inspection.py",
        "swarm/onboard/integrity.py",
        "swarm/onboard/lidar.py",
        "swarm/onboard/lighthouse_fix.py",
        "swarm/report/page.py",
        "swarm/report/run_table.py",
        "swarm/sensors/broad_phase.py",
        "swarm/sensors/ccd.py",
        "swarm/sensors/crossing.py",
        "swarm/sensors/hits.py",
        "swarm/sensors/lighthouse.py",
        "swarm/sensors/line_of_sight.py",
        "swarm/sensors/mirror.py",
        "swarm/sensors/pulse_faults.py",
        "swarm/sensors/solids.py",
        "swarm/sensors/visibility.py",
        "swarm/studies/calibration/calibrate.py",
        "swarm/studies/calibration/report.py",
        "swarm/studies/calibration/survey.py",
        "swarm/studies/campaign/onboard_cost.py",
        "swarm/studies/campaign/study.py",
        "swarm/studies/layout/even.py",
        "swarm/studies/layout/figure.py",
        "swarm/studies/layout/judgement.py",
        "swarm/studies/layout/poses.py",
        "swarm/studies/layout/prediction.py",
        "swarm/studies/layout/report.py",
        "swarm/studies/layout/search.py",
        "swarm/studies/layout/sight.py",
        "swarm/studies/layout/smallest.py",
        "swarm/studies/layout/study.py",
        "swarm/studies/papers/lighthouse_error_budget.py",
        "swarm/world/assembly.py",
        "swarm/world/docking.py",
        "swarm/world/execution.py",
        "swarm/world/motion/pointing.py",
        "swarm/world/nearby.py",
        "swarm/world/orbit.py",
        "swarm/world/refit.py",
        "swarm/world/world.py",
        "swarm/world/wrench.py",
    }
)
OPENINGS_NOT_YET: frozenset[str] = frozenset(
    {
        "estimators/frame.py",
        "estimators/kernel.py",
        "swarm/assets.py",
        "swarm/cli/options.py",
        "swarm/cli/progress.py",
        "swarm/cli/replay.py",
        "swarm/flight/builders/guidance.py",
        "swarm/flight/faults/__init__.py",
        "swarm/flight/faults/injection.py",
        "swarm/flight/faults/schedule.py",
        "swarm/flight/recordings/framing.py",
        "swarm/flight/recordings/libsurvive.py",
        "swarm/flight/recordings/station_calibration.py",
        "swarm/flight/recordings/tracked_object.py",
        "swarm/flight/replay.py",
        "swarm/flight/scene.py",
        "swarm/hardware.py",
        "swarm/messages.py",
        "swarm/onboard/__init__.py",
        "swarm/onboard/acquisition.py",
        "swarm/onboard/actuation/modulation.py",
        "swarm/onboard/actuation/orders.py",
        "swarm/onboard/ccd.py",
        "swarm/onboard/computer.py",
        "swarm/onboard/control.py",
        "swarm/onboard/flashes.py",
        "swarm/onboard/guidance/__init__.py",
        "swarm/onboard/guidance/assignment.py",
        "swarm/onboard/guidance/broadcast.py",
        "swarm/onboard/guidance/docking.py",
        "swarm/onboard/guidance/formation.py",
        "swarm/onboard/guidance/guidance.py",
        "swarm/onboard/guidance/phase.py",
        "swarm/onboard/inspection.py",
        "swarm/onboard/integrity.py",
        "swarm/onboard/lighthouse_fix.py",
        "swarm/onboard/navigation.py",
        "swarm/onboard/pilot.py",
        "swarm/onboard/settings.py",
        "swarm/onboard/tracks.py",
        "swarm/results/progress.py",
        "swarm/scenario/motions/base.py",
        "swarm/sensors/__init__.py",
        "swarm/sensors/broad_phase.py",
        "swarm/sensors/ccd.py",
        "swarm/sensors/hits.py",
        "swarm/sensors/lidar.py",
        "swarm/sensors/lighthouse.py",
        "swarm/sensors/line_of_sight.py",
        "swarm/sensors/mirror.py",
        "swarm/sensors/pulse_faults.py",
        "swarm/sensors/sight.py",
        "swarm/sensors/solids.py",
        "swarm/sensors/suite.py",
        "swarm/sensors/visibility.py",
        "swarm/studies/calibration/report.py",
        "swarm/studies/calibration/survey.py",
        "swarm/studies/campaign/cluster.py",
        "swarm/studies/campaign/measures.py",
        "swarm/studies/campaign/plan.py",
        "swarm/studies/campaign/study.py",
        "swarm/studies/campaign/task.py",
        "swarm/studies/layout/__init__.py",
        "swarm/studies/layout/judgement.py",
        "swarm/studies/layout/prediction.py",
        "swarm/studies/layout/request.py",
        "swarm/studies/layout/search.py",
        "swarm/studies/layout/smallest.py",
        "swarm/studies/layout/study.py",
        "swarm/studies/papers/bench.py",
        "swarm/studies/papers/experiment.py",
        "swarm/studies/papers/lighthouse_dynamic.py",
        "swarm/studies/papers/rungs.py",
        "swarm/world/actuators.py",
        "swarm/world/craft.py",
        "swarm/world/docking.py",
        "swarm/world/execution.py",
        "swarm/world/hull.py",
        "swarm/world/motion/__init__.py",
        "swarm/world/motion/disturbance.py",
        "swarm/world/motion/fleet.py",
        "swarm/world/nearby.py",
        "swarm/world/orbit.py",
        "swarm/world/pushes.py",
        "swarm/world/world.py",
        "swarm/world/wrench.py",
    }
)


def undocumented(module: str) -> dict[str, list[str]]:
    """Return the public functions of a module with parameters that their `Args:` block leaves out."""
    if module.startswith(COMMANDS):
        return {}
    functions = public_functions(ast.parse((ROOT / module).read_text()))
    return {one.name: one.undocumented for one in functions if one.undocumented}


def fragments(module: str) -> list[str]:
    """Return the docstrings of a module that open with a fragment, each with its line and name."""
    found = []
    for node in ast.walk(ast.parse((ROOT / module).read_text())):
        if not isinstance(node, ast.Module | ast.ClassDef | Function):
            continue
        text = ast.get_docstring(node) or ""
        if re.split(r"\W", text, maxsplit=1)[0] in FRAGMENTS:
            line, name = (1, "") if isinstance(node, ast.Module) else (node.lineno, f" {node.name}")
            found.append(f"{module}:{line}{name}: {text.splitlines()[0]}")
    return found


@pytest.mark.parametrize("module", MODULES)
def test_many_parameters_have_an_args_block(module: str) -> None:
    missing = undocumented(module)
    if module in ARGS_NOT_YET:
        assert missing, f"{module} is done: take it off ARGS_NOT_YET"
    else:
        assert not missing, "no complete Args block: " + "; ".join(f"{f}({', '.join(p)})" for f, p in missing.items())


@pytest.mark.parametrize("module", MODULES)
def test_docstrings_do_not_open_with_a_fragment(module: str) -> None:
    found = fragments(module)
    if module in OPENINGS_NOT_YET:
        assert found, f"{module} is done: take it off OPENINGS_NOT_YET"
    else:
        assert not found, "\n".join(found)


def test_the_rule_is_held_where_it_is_broken() -> None:
    text = 'class A:\n def f(self, a, *b, c):\n  """F.\n\n  Args:\n      a: one.\n      *b: two.\n  """'
    (one,) = public_functions(ast.parse(text))
    assert (one.name, one.parameters, one.undocumented) == ("A.f", ("a", "c", "b"), ["c"])

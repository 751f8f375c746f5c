"""The sentences about missed criteria and dockings, on flights made up so that the answer is known."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from numpy.random import default_rng
from synthetic_run import estimate_of, period_of, truth_at

from swarm.report.findings import reasons
from swarm.results.criteria import judge
from swarm.results.reasons import Docking, docking, navigation
from swarm.results.records import Equipment
from swarm.results.summary import summarise_run
from swarm.results.table import TelemetryTable
from swarm.results.telemetry import Telemetry
from swarm.scenario import Criterion


def flight(**column: list[Any]) -> TelemetryTable:
    """A craft with a docking, ten rows of one second from 1 m to 0.1 m, all well unless a column says otherwise."""
    made: dict[str, list[Any]] = {
        "time_s": [float(i) for i in range(10)],
        "frame": list(range(10)),
        "craft": ["probe"] * 10,
        "status": ["tracking"] * 10,
        "visible": [4] * 10,
        "contact": [False] * 10,
        "phase": ["final"] * 10,
        "position_error_m": [0.001 * i for i in range(10)],
        "docking_range_m": [1.0 - 0.1 * i for i in range(10)],
        "docking_lateral_m": [0.004] * 10,
        "docking_angle_deg": [0.5] * 10,
        "docking_speed_m_s": [0.1] * 10,
        **column,
    }
    table = pa.table(made)
    for name in {"craft", "status", "phase", "fault"} & set(made):
        table = table.set_column(table.column_names.index(name), name, table.column(name).dictionary_encode())
    four = '[[1, 4, ["lighthouse"]]]'
    return TelemetryTable.of(table.replace_schema_metadata({"craft_equipment": four}))


def end(rows: TelemetryTable) -> Docking:
    found = docking(rows, rows.frame)
    assert found is not None
    return found


BLIND: dict[str, list[Any]] = {"status": ["tracking"] * 5 + ["coasting"] * 5, "visible": [4] * 5 + [3] * 5}


def test_a_docking_says_what_became_of_it() -> None:
    assert end(flight(**BLIND)) == Docking(
        False, 5.0, "no contact: blind since 5.0 s, 3 of 4 photodiodes lit, lost 0.50 m before the port"
    )
    # Lost for a while, and back: that is not why.
    back = {"status": ["tracking"] * 3 + ["coasting"] * 2 + ["tracking"] * 5}
    told = "no contact: time ran out at 9.0 s, 0.10 m before the port, in phase final; "
    assert end(flight(**back)).sentence == f"{told}blind 3.0 s to 5.0 s"
    assert end(flight()).sentence == f"{told}tracking then, 4 of 4 photodiodes lit"
    phases = ["wait"] * 2 + ["final", "retreat"] * 2 + ["final"] * 4
    dark = ["none"] * 3 + ["lighthouse-dark"] * 2 + ["none"] * 5
    lost = "blind 3.0 s to 5.0 s (fault lighthouse-dark), retreated twice, waited 2.0 s for its navigation before it"
    assert end(flight(**back, phase=phases, fault=dark)).sentence.startswith(told + lost)
    # Dead photodiodes are none that could be lit.
    dead = end(flight(**BLIND, fault=["none"] * 5 + ["photodiode-dead"] * 5)).sentence
    assert (
        dead == "no contact: blind since 5.0 s (fault photodiode-dead), 3 photodiodes lit, lost 0.50 m before the port"
    )
    never = end(flight(status=["searching"] * 10, visible=[2] * 10)).sentence
    assert never == "no contact: it never had a pose, 2 of 4 photodiodes lit, 0.10 m before the port"
    gave_up = end(flight(phase=["final"] * 6 + ["aborted"] * 4))
    assert gave_up.sentence.startswith(
        "no contact: it gave up after its last retreat, at 6.0 s, 0.40 m before the port"
    )
    touched = {"contact": [False] * 8 + [True, False]}
    missed = "contact at 8.0 s, but no capture: 4.0 mm beside the axis, 0.50°, 0.100 m/s before it"
    assert end(flight(**touched)).sentence == missed
    docked = end(flight(**touched, phase=["final"] * 9 + ["docked"]))
    assert docked == Docking(True, 9.0, "docked at 9.0 s, 4.0 mm beside the axis, 0.50°, 0.100 m/s")


@pytest.mark.parametrize(
    ("criterion", "time_s", "why"),
    [
        (
            {"measure": "docking_lateral_m", "statistic": "at_contact", "max": 0.01, "craft": ("probe",)},
            None,
            "no value (limit: ≤ 10 mm); no contact: blind since 5.0 s, 3 of 4 photodiodes lit, lost 0.50 m before "
            "the port",
        ),
        (
            {"measure": "position_error_m", "max": 0.005},
            9.0,
            "9.00 mm (limit: ≤ 5 mm): probe at 9.0 s; blind since 5.0 s, 3 of 4 photodiodes lit",
        ),
        (
            {"measure": "position_error_m", "statistic": "mean", "max": 0.001},
            None,
            "4.50 mm (limit: ≤ 1 mm): largest, 0.009 m, probe at 9.0 s; blind since 5.0 s, 3 of 4 photodiodes lit",
        ),
        (
            {"measure": "position_error_m", "max": 0.001, "to_s": 2.0},
            2.0,
            "2.00 mm (limit: ≤ 1 mm): probe at 2.0 s; tracking then, 4 of 4 photodiodes lit",
        ),
        (
            {"measure": "longest_blind_s", "max": 0.5},
            None,
            "5.00 s (limit: ≤ 0.5 s): probe from 5.0 s to 9.0 s; blind since 5.0 s, 3 of 4 photodiodes lit",
        ),
        (
            {"measure": "tracking_share", "min": 0.99},
            None,
            "0.500 (limit: ≥ 0.99): probe from 5.0 s to 9.0 s; blind since 5.0 s, 3 of 4 photodiodes lit",
        ),
        ({"measure": "contacts", "min": 1, "max": 2}, None, "0 (limit: 1 to 2)"),
    ],
)
def test_a_missed_criterion_says_why(criterion: dict[str, Any], time_s: float | None, why: str) -> None:
    found = judge([Criterion(**criterion)], flight(**BLIND))[0]
    assert found.held is False
    assert found.time_s == time_s
    assert found.why is not None
    assert "limit" not in found.why
    (told,) = reasons([found._asdict()])
    assert told.text.startswith(f"{found.name}: {why}")


def test_a_missed_contact_speed_says_what_was_commanded() -> None:
    fast = Criterion(measure="docking_speed_m_s", statistic="at_contact", max=0.05, craft=("probe",))
    rows = flight(contact=[False] * 8 + [True, True], phase=["final"] * 8 + ["docked"] * 2)
    (told,) = reasons([judge([fast], rows, {"probe": 0.03})[0]._asdict()])
    assert told.text == (
        "docking_speed_at_contact_m_s: 100 mm/s (limit: ≤ 50 mm/s): probe at 7.0 s; "
        "tracking then, 4 of 4 photodiodes lit, commanded 0.03 m/s"
    )


@pytest.mark.parametrize(("rows", "said"), [(3, "3 single sweeps"), (1, "1 single sweep"), (None, "single sweeps")])
def test_few_photodiodes_are_told_by_their_sweeps(rows: int | None, said: str) -> None:
    """Photodiodes that one fan alone has seen count as none that is lit."""
    few: dict[str, list[Any]] = {"status": ["single_sweeps"] * 10, "visible": [0] * 10}
    if rows is not None:
        few["rows"] = [rows] * 10
    assert navigation(flight(**few), 6) == f"by {said} then"


def test_a_shared_reason_is_told_once() -> None:
    missed = [
        Criterion(measure=f"docking_{name}", statistic="at_contact", max=0.01, craft=("probe",))
        for name in ("lateral_m", "angle_deg")
    ]
    first, second = reasons([verdict._asdict() for verdict in judge(missed, flight(**BLIND))])
    assert first.text.endswith("no contact: blind since 5.0 s, 3 of 4 photodiodes lit, lost 0.50 m before the port")
    assert second.text == "docking_angle_at_contact_deg: no value (limit: ≤ 0.01 °); for the same reason"


def test_a_criterion_that_holds_needs_no_reason() -> None:
    assert judge([Criterion(measure="position_error_m", max=0.01)], flight())[0].why is None


def test_the_summary_has_no_means_over_different_sensors(tmp_path: Path) -> None:
    """Three craft, one of them by cameras, and one that navigates by nothing: equipment goes through the file."""
    light, cameras = Equipment(9, ("lighthouse",)), Equipment(0, ("cameras",))
    summaries = []
    for folder, second in (("mixed", cameras), ("alike", light)):
        (tmp_path / folder).mkdir()
        kit = (light, second, light, Equipment(0, ()))
        out, rng = Telemetry(tmp_path / folder, ("a", "eye", "b", "dumb"), (), ("dumb",), kit, 4e-5), default_rng(1)
        for frame in range(30):
            truth = truth_at(frame / 60, 4)
            out.append(period_of(frame / 60, frame, truth, estimate_of(truth, rng)))
        out.close()
        summaries.append(summarise_run(tmp_path / folder))
    mixed, alike = summaries
    assert "groups" not in alike
    assert list(mixed["groups"]) == ["lighthouse", "cameras"]
    for key in ("ekf_position_rms_m", "nees", "mean_visible", "mean_adop_deg_per_rad"):
        assert mixed["swarm"][key] is None
        assert alike["swarm"][key] is not None
        assert mixed["groups"]["cameras"][key] == mixed["craft"]["eye"][key]
    assert mixed["swarm"]["samples"] == alike["swarm"]["samples"] == 90
    squares = [mixed["craft"][name]["ekf_position_rms_m"] ** 2 for name in "ab"]
    assert mixed["groups"]["lighthouse"]["ekf_position_rms_m"] ** 2 == pytest.approx(sum(squares) / 2)
    # ADOP 900 deg/rad and PDOP 15 m/rad at 4e-5 rad of noise.
    assert mixed["craft"]["a"]["predicted_attitude_deg"] == pytest.approx(0.036)
    assert mixed["craft"]["a"]["predicted_position_m"] == pytest.approx(6e-4)

"""Criteria: every statistic against a plain loop over rows, and how a run says that one did not hold."""

import math

import numpy as np
import pyarrow as pa
import pytest

import swarm
from swarm.errors import SwarmError
from swarm.report.run import run_page
from swarm.report.subject import Subject
from swarm.results.columns.core import STATUS
from swarm.results.columns.schema import schema
from swarm.results.criteria import check_measures, judge, summary_of
from swarm.results.table import TelemetryTable
from swarm.scenario import Criterion

NAMES = ("left", "right", "dumb")


@pytest.fixture(scope="module")
def rows():
    """Two craft that fly and one that never knows anything; left touches something at 3 s, right never does."""
    rng, out = np.random.default_rng(4), []
    for frame in range(50):
        for i, name in enumerate(NAMES):
            blind = i == 2 or 10 <= frame < 14 or (i == 1 and frame > 45)
            out.append(
                {
                    "time_s": 0.1 * frame,
                    "frame": frame,
                    "craft": name,
                    "status": STATUS[2 if blind else 1],
                    "contact": i == 0 and 30 <= frame < 33,
                    "position_error_m": None if blind else float(rng.uniform(0, 0.01)),
                    "docking_range_m": 3.0 - 0.1 * frame if i == 0 else None,
                    **{f"true_p{a}_m": float(rng.normal()) for a in "xyz"},
                }
            )
    return out


@pytest.fixture(scope="module")
def load(rows):
    table = pa.Table.from_pylist(rows)
    table = table.set_column(2, "craft", table.column("craft").dictionary_encode())
    table = table.set_column(3, "status", table.column("status").dictionary_encode())
    return TelemetryTable.of(table)


def verdict(load, **criterion):
    return judge([Criterion(**criterion)], load)[0]


@pytest.mark.parametrize(
    ("statistic", "of"),
    [
        ("rms", lambda x: math.sqrt(sum(v * v for v in x) / len(x))),
        ("mean", lambda x: sum(x) / len(x)),
        ("max", max),
        ("min", min),
        ("sum", sum),
    ],
)
def test_statistics_are_those_of_a_plain_loop(rows, load, statistic, of):
    mine = [
        r["position_error_m"]
        for r in rows
        if r["craft"] in ("left", "right") and 1.0 <= r["time_s"] <= 4.0 and r["position_error_m"] is not None
    ]
    found = verdict(
        load, measure="position_error_m", statistic=statistic, max=1.0, craft=("left", "right"), from_s=1.0, to_s=4.0
    )
    assert found.value == pytest.approx(of(mine), rel=1e-12)
    limit = of(mine)
    assert verdict(load, measure="position_error_m", statistic=statistic, max=1.01 * limit, from_s=1.0, to_s=4.0).held
    assert not verdict(
        load, measure="position_error_m", statistic=statistic, max=0.99 * limit, from_s=1.0, to_s=4.0
    ).held


def test_at_contact_is_the_row_before_the_first_contact_and_last_the_last_known_one(rows, load):
    touch = verdict(load, measure="docking_range_m", statistic="at_contact", max=0.2)
    assert (touch.value, touch.craft, touch.held) == (pytest.approx(0.1), "left", True)
    last = verdict(load, measure="docking_range_m", statistic="last", min=-2.0, max=-1.8)
    assert last.value == pytest.approx(-1.9)
    assert last.held
    right = [r["position_error_m"] for r in rows if r["craft"] == "right" and r["position_error_m"] is not None][-1]
    found = verdict(load, measure="position_error_m", statistic="last", max=1.0, craft=("right",))
    assert found.value == pytest.approx(right)


def test_the_worst_of_the_craft_counts(rows, load):
    last = {
        n: [r["position_error_m"] for r in rows if r["craft"] == n and r["position_error_m"]][-1] for n in NAMES[:2]
    }
    worst = max(last, key=lambda n: last[n])
    found = verdict(load, measure="position_error_m", statistic="last", max=min(last.values()))
    assert (found.craft, found.held) == (worst, False)
    assert found.value == pytest.approx(last[worst])


def test_what_does_not_exist_is_not_held(load):
    for missing in (
        {"measure": "docking_range_m", "statistic": "at_contact", "max": 1.0, "craft": ("right",)},
        {"measure": "position_error_m", "max": 1.0, "craft": ("dumb",)},
        {"measure": "longest_blind_s", "max": 100.0, "craft": ("dumb",)},
        {"measure": "separation_m", "min": 0.0, "craft": ("left",)},
    ):
        found = verdict(load, **missing)
        assert found.value is None
        assert not found.held


def test_named_measures_are_those_of_a_plain_loop(rows, load):
    assert verdict(load, measure="contacts", max=0).value == 3
    share = sum(r["status"] == "tracking" for r in rows if r["craft"] != "dumb") / 100
    assert verdict(load, measure="tracking_share", min=0.5, craft=("left", "right")).value == pytest.approx(share)
    # From the last pose at 0.9 s to the next at 1.4 s; and right ends blind, from 4.5 s to 4.9 s.
    assert verdict(load, measure="longest_blind_s", max=1.0).value == pytest.approx(0.5)
    assert verdict(load, measure="longest_blind_s", max=1.0, from_s=2.0).value == pytest.approx(0.4)
    place = {(r["frame"], r["craft"]): [r[f"true_p{a}_m"] for a in "xyz"] for r in rows}
    least = min(
        math.dist(place[frame, a], place[frame, b])
        for frame in range(50)
        for a, b in (NAMES[:2], NAMES[1:], NAMES[::2])
    )
    assert verdict(load, measure="separation_m", min=0.0).value == pytest.approx(least)


def test_limits_belong_to_what_is_allowed(load):
    assert verdict(load, measure="contacts", min=3, max=3).held
    assert not verdict(load, measure="contacts", min=3.1).held


def test_what_begins_after_the_end_of_the_run_is_not_judged(load):
    late = verdict(load, measure="contacts", min=1e3, from_s=1e4)
    assert late.held is None
    assert late.value is None
    held = verdict(load, measure="contacts", max=1e3)
    assert summary_of([late, held])["criteria_held"] is True


def test_summary_says_whether_all_held(load):
    held, missed = Criterion(measure="contacts", max=3), Criterion(measure="separation_m", min=1e3)
    assert summary_of(judge([held], load))["criteria_held"] is True
    both = summary_of(judge([held, missed], load))
    assert both["criteria_held"] is False
    assert [v["held"] for v in both["criteria"]] == [True, False]
    assert summary_of([]) == {}


@pytest.mark.parametrize(
    ("criterion", "label"),
    [
        ({"measure": "position_error_m", "statistic": "rms"}, "position_error_rms_m"),
        ({"measure": "docking_speed_m_s", "statistic": "at_contact"}, "docking_speed_at_contact_m_s"),
        ({"measure": "adop_deg_per_rad", "statistic": "mean"}, "adop_mean_deg_per_rad"),
        ({"measure": "position_error_m"}, "position_error_m"),
        ({"measure": "contacts", "statistic": "sum"}, "contacts"),
        ({"measure": "nees", "statistic": "mean", "name": "consistent"}, "consistent"),
    ],
)
def test_names_keep_their_unit_at_the_end(criterion, label):
    assert Criterion(max=1, **criterion).label == label


def test_a_measure_that_is_no_number_of_the_run_is_a_mistake_with_the_nearest_one():
    with pytest.raises(SwarmError, match=r"criteria\[0\].measure = 'position_eror_m'.*did you mean 'position_error_m'"):
        check_measures([Criterion(measure="position_eror_m", max=1)], schema(), "mine")
    with pytest.raises(SwarmError, match=r"criteria\[0\].measure = 'status'"):
        check_measures([Criterion(measure="status", max=1)], schema(), "mine")


SCENARIO = """
duration_s = 0.5
[[craft]]
name = "one"
[[criteria]]
measure = "position_error_m"
from_s = 0.25
max = {limit}
"""


@pytest.mark.parametrize(("limit", "code", "word"), [(1.0, 0, "held"), (1e-9, 1, "MISSED")])
def test_a_run_prints_which_held_and_its_exit_code_says_it(tmp_path, capsys, monkeypatch, limit, code, word):
    from swarm.cli import app as cli

    file = tmp_path / "short.toml"
    file.write_text(SCENARIO.format(limit=limit))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["swarm", "run", str(file), "--no-recording"])
    assert cli.main() == code
    out = capsys.readouterr().out
    assert word in out
    assert "position_error_m" in out
    run = swarm.open_run(tmp_path / "runs" / "short-0")
    assert run.summary["criteria_held"] is (code == 0)
    page = run_page(Subject(run))
    criteria = next(section for section in page.sections if section.title == "Criteria")
    assert criteria.tables[0].rows[0][:2] == ["position_error_m", word.lower()]
    # Value and limit have a unit, and the same words on the page and in the terminal.
    limit_text = {1.0: "≤ 1 m", 1e-9: "≤ 1e-06 mm"}[limit]
    assert criteria.tables[0].rows[0][4] == limit_text == page.facts[0].meaning.partition(". ")[0]
    assert limit_text in out
    value = criteria.tables[0].rows[0][3]
    assert value == page.facts[0].value
    assert value in out
    assert float(value.split()[0]) * {"m": 1, "mm": 1e-3}[value.split()[1]] == pytest.approx(
        run.summary["criteria"][0]["value"], rel=5e-3
    )
    assert page.facts[0].badge == ("PASS" if code == 0 else "FAIL")
    assert page.verdict_kind == ("pass" if code == 0 else "fail")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("max = 1.0\ncraft = ['two']", r"criteria\[0\].craft\[0\].*no craft has this name; known: one"),
        ("", r"criteria\[0\].max.*needs a limit"),
        ("min = 2.0\nmax = 1.0", r"criteria\[0\].min = 2.0: must be at most max"),
        ("max = 1.0\nfrom_s = 0.2\nto_s = 0.1", r"criteria\[0\].to_s.*after from_s"),
    ],
)
def test_mistakes_in_a_criterion_name_key_and_value(tmp_path, text, message):
    file = tmp_path / "wrong.toml"
    file.write_text(f'duration_s = 1.0\n[[craft]]\nname = "one"\n[[criteria]]\nmeasure = "contacts"\n{text}\n')
    with pytest.raises(SwarmError, match=message):
        swarm.load(file)

"""The report is one file that opens anywhere: no reference leads out of it, and its figures say what the rows say."""

import json
import re
import sys
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
import pytest

from swarm.cli import app as cli
from swarm.errors import SwarmError
from swarm.flight.simulate import simulate
from swarm.report.figures import thin
from swarm.report.numbers import number
from swarm.report.page import Page, percent
from swarm.report.rows import Rows, finished
from swarm.report.run import extent, run_page
from swarm.report.scaling_figures import central_line
from swarm.report.sections import faults
from swarm.report.sections.criteria import cards
from swarm.report.sections.faults import section as fault_section
from swarm.report.subject import Strike, Subject
from swarm.report.sweep_figures import Key, against_two
from swarm.report.write import study_page, write_report
from swarm.results.owned_folder import Status
from swarm.results.run_folder import open_run
from swarm.scenario import load
from swarm.studies.campaign.study_folder import StudyFolder, open_study

COUNTS = (1, 10, 100)
PERIOD_S = 1 / 60


def row(number: int, craft: int, seed: int) -> dict[str, Any]:
    """A row as a scaling study has it, with figures that are known in advance."""
    return {
        "run": number,
        "key": f"{number:016x}",
        "status": "complete",
        "reason": None,
        "seed": seed,
        "swarm.count": craft,
        "periods": 180,
        "flown_s": 180 * PERIOD_S,
        "tracking_share": 1 - craft / 1000,
        "lit_share": 1 - craft / 500,
        "nees_mean": 6.0 + 0.1 * seed,
        "nees_band_low": 5.5,
        "nees_band_high": 6.5,
        **{f"{who}_position_rms_m": 0.001 for who in ("pnp", "ekf", "central", "own")},
        **{f"{who}_attitude_rms_deg": 0.05 for who in ("pnp", "ekf", "central", "own")},
        "onboard_alone_us": 300.0,
        "onboard_swarm_per_craft_us": 300.0 / craft + 50,
        "onboard_alone_apart_m": 0.0,
        "central_solve_us": 40.0 + 8.0 * craft,
        "own_solve_us": 42.0,
        "central_craft": float(craft),
        "central_air_bytes_per_s": 7440.0 * craft,
        "own_air_bytes_per_s": 0.0,
        **{
            f"{who}_{what}_gain_share": 1e-5 * craft
            for who in ("central", "rotor_known")
            for what in ("position", "attitude")
        },
        "rotor_variance_found_share": 0.001 * craft,
        "seconds": 1.0,
    }


def study(folder: Path, rows: list[dict[str, Any]], parameters: list[str], status: Status = "complete") -> Path:
    made = StudyFolder(folder, parameters, {})
    (folder / "study.toml").write_text('base = "cloud"\n')
    for one in rows:
        made.add(one)
    made.finish({})
    made.mark(
        status,
        {
            "name": "made-up",
            "description": "Made up <b>",
            "command": "swarm study made-up",
            "versions": ["numpy 1"],
            "wall_s": 9.0,
            "where": "2 workers",
            "machine": "none",
            "planned": len(rows),
        },
    )
    return folder


@pytest.fixture
def scaling(tmp_path: Path) -> Path:
    rows = [row(2 * i + seed, craft, seed) for i, craft in enumerate(COUNTS) for seed in range(2)]
    return study(tmp_path / "scaling", rows, ["swarm.count"])


class Seen(HTMLParser):
    """Everything that a browser might fetch, the embedded pictures, and the text."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.pictures: list[bytes] = []
        self.narrow: list[bytes] = []
        self.tags: list[str] = []
        self.words = ""
        self.html = page.read_text(encoding="utf-8")
        self.feed(self.html)
        self.text = " ".join(self.words.split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "srcset", "data", "action", "poster") and value:
                if value.startswith("data:image/svg+xml;base64,"):
                    (self.narrow if name == "srcset" else self.pictures).append(b64decode(value.partition(",")[2]))
                else:
                    self.links.append(value)

    def handle_data(self, data: str) -> None:
        self.words += data + " "


def words(page: Page) -> str:
    """The words of a page, without its figures, which take long to draw."""
    texts = [page.title, page.subtitle, page.warning, *(text for fact in page.facts for text in fact)]
    for section in page.sections:
        texts += [section.title, *section.paragraphs, *(picture.caption for picture in section.pictures)]
        texts += [cell for table in section.tables for row in table.rows for cell in row]
    return " ".join(texts)


def check_self_contained(seen: Seen) -> None:
    assert seen.links == []
    assert not {"script", "link", "iframe", "object", "embed"} & set(seen.tags)
    assert not re.search(r"https?:|url\(|@import|//[a-z]", seen.html)
    assert len(seen.narrow) == len(seen.pictures)
    for picture in (*seen.pictures, *seen.narrow):
        # Well-formed, and its only references are to its own definitions and to pixels that it carries.
        root = ElementTree.fromstring(picture)
        for element in root.iter():
            for name, value in element.attrib.items():
                if name.endswith("href"):
                    assert value.startswith(("#", "data:image/png"))


@pytest.mark.long
def test_the_scaling_page_is_self_contained_and_complete(scaling: Path) -> None:
    page, figures = write_report(scaling)
    seen = Seen(page)
    check_self_contained(seen)
    names = {"onboard-time", "visibility", "precision", "central-cost", "central-gain"}
    assert {file.name for file in figures} == {f"{name}.{suffix}" for name in names for suffix in ("svg", "png")}
    assert all(file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" for file in figures if file.suffix == ".png")
    assert len(seen.pictures) == 5
    assert "Made up <b>. 6 runs, 9 s on 2 workers" in seen.text
    for unit in ("µs/period", "MB/s", "mm", "°", "%"):
        assert unit in seen.text
    assert "swarm study made-up" in seen.text
    assert "numpy 1" in seen.text


def test_the_scaling_page_says_what_the_rows_say(scaling: Path) -> None:
    text = words(study_page(open_study(scaling)))
    assert "It needs 300 to 300 µs per lighthouse period, 1.00 times as much with 100 craft as with 1" in text
    assert "Cost from 1 to 100 craft: 40.0 µs + 8.00 µs per craft and period, against 42.0 µs" in text
    # Nothing is carried on beyond the 100 craft that were flown: (40 + 8 * 100) of 16 666.7 us.
    assert "With 100 craft, the most that were flown, it fills 5.0 % of the lighthouse's period of 16.7 ms" in text
    assert "keeps pace" not in text
    assert "from the first craft on; with 100 craft 20.0 times as much" in text
    assert "0.10 % with 100, for 0.744 MB/s" in text
    line = central_line(Rows.of(open_study(scaling), "swarm.count"))
    assert line is not None
    assert line.limit_craft is None


def test_a_central_solver_that_fills_the_period_says_with_how_many_craft(tmp_path: Path) -> None:
    # (16 666.7 - 40) / 8 = 2078 craft.
    rows = [row(i, craft, 0) for i, craft in enumerate((1, 1000, 4000))]
    folder = study(tmp_path / "large", rows, ["swarm.count"])
    line = central_line(Rows.of(open_study(folder), "swarm.count"))
    assert line is not None
    assert line.limit_craft == pytest.approx((1e6 * PERIOD_S - 40) / 8, rel=1e-9)


def test_what_was_not_measured_is_left_out(tmp_path: Path) -> None:
    rows = [
        {k: v for k, v in row(i, craft, 0).items() if "central" not in k and "own_" not in k}
        for i, craft in enumerate(COUNTS)
    ]
    page = study_page(open_study(study(tmp_path / "part", rows, ["swarm.count"])))
    assert "central" not in words(page)
    assert len(page.pictures) == 3


def test_any_study_shows_its_keys_its_points_and_its_failures(tmp_path: Path) -> None:
    rows = []
    for i in range(6):
        one = {**row(i, 8, i % 2), "lighthouse.angle_noise_arcsec": 5.0 * (1 + i // 2)}
        rows.append({k: v for k, v in one.items() if "onboard" not in k and "central" not in k and k != "swarm.count"})
    rows[5] = {
        **{k: rows[5][k] for k in ("run", "key", "seed", "lighthouse.angle_noise_arcsec", "seconds")},
        "status": "failed",
        "reason": "<script>alert(1)</script> is no model",
    }
    folder = study(tmp_path / "sweep", rows, ["lighthouse.angle_noise_arcsec"], status="interrupted")
    page, figures = write_report(folder, tmp_path / "elsewhere" / "page.html")
    seen = Seen(page)
    check_self_contained(seen)
    assert page == tmp_path / "elsewhere" / "page.html"
    assert figures[0].parent.name == "page-figures"
    assert "lighthouse angle noise arcsec" in seen.text
    assert "1 ± 0" in seen.text
    assert "1.00 ± 0" not in seen.text
    assert "1 of 6 runs have no figures" in seen.text
    assert "<script>alert(1)</script> is no model" in seen.text
    assert "not complete: 6 of 6 runs" in seen.text


def test_a_run_has_a_page_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    simulate(load("formation", ["duration_s=0.5", "swarm.count=5"]), record=False)
    monkeypatch.setattr(sys, "argv", ["swarm", "report", "runs/formation-7"])
    assert cli.main() == 0
    assert capsys.readouterr().out.startswith("runs/formation-7/report.html")
    seen = Seen(Path("runs/formation-7/report.html"))
    check_self_contained(seen)
    assert len(seen.pictures) == 7
    for word in (
        "craft-0",
        "craft-4",
        "NEES",
        "ADOP",
        "PDOP",
        "Trajectory",
        "Eight craft on a turning ring",
        "swarm run runs/formation-7/scenario.toml",
        "mujoco",
    ):
        assert word in seen.html + "".join(p.decode() for p in seen.pictures), word


def test_two_keys_are_lines_or_a_map_and_figures_for_a_paper(tmp_path: Path) -> None:
    keys = ["craft[0].feedback", "lighthouse.angle_noise_arcsec"]
    rows = []
    for i in range(8):
        one = {**row(i, 8, i % 2), keys[0]: ("truth", "estimate")[i // 4], keys[1]: (5.0, 20.0)[i // 2 % 2]}
        rows.append({k: v for k, v in one.items() if "onboard" not in k and "central" not in k and k != "swarm.count"})
    folder = study(tmp_path / "two", rows, keys)
    _, files = write_report(folder, paper="pdf")
    stem = "against-lighthouse-angle_noise_arcsec-and-craft-0-feedback"
    names = [f"{stem}.svg", f"{stem}.png", f"{stem}-page.pdf", f"{stem}-column.pdf"]
    assert [file.name for file in files] == names
    pdf = files[2].read_bytes()
    assert pdf.startswith(b"%PDF")
    # Text stays text, in a typeface of a paper, as TrueType.
    assert b"STIXGeneral" in pdf
    assert b"/Type3" not in pdf
    assert "a line per value of craft[0] feedback" in (folder / "report.html").read_text()
    columns = finished(open_study(folder))
    many = [Key.of("a", list(range(8))), Key.of("b", list(range(8)))]
    assert "Figures of merit over a and b" in against_two(columns, *many).caption


def test_a_keys_values_stand_where_they_are_and_words_in_a_row() -> None:
    noise = Key.of("noise_arcsec", [20.0, 5.0, 20.0])
    assert (noise.points, noise.which.tolist(), noise.place.tolist()) == ([5.0, 20.0], [1, 0, 1], [5.0, 20.0])
    word = Key.of("craft[0].feedback", ["truth", "estimate", "truth"])
    assert (word.points, word.which.tolist(), word.place.tolist()) == (["truth", "estimate"], [0, 1, 0], [0.0, 1.0])


def test_faults_are_listed_with_their_times_and_what_the_scenario_says_of_them(tmp_path: Path) -> None:
    faults = [
        '{kind="lighthouse-dark", at_s=0.2, for_s=0.1}',
        '{kind="photodiode-dead", craft=["craft-1", "craft-2"], photodiodes=[0, 5], at_s=0.3}',
    ]
    scenario = load("formation", ["duration_s=0.5", "swarm.count=3", f"fault=[{', '.join(faults)}]"])
    subject = Subject(simulate(scenario, out=tmp_path / "faulty", record=False))
    dark, dead = subject.strikes
    assert (dark.kind, dark.craft, dark.lasts) == ("lighthouse-dark", (), False)
    assert (dark.from_s, dark.to_s) == pytest.approx((0.2, 0.3), abs=1e-6)
    assert (dead.kind, dead.craft, dead.lasts) == ("photodiode-dead", (1, 2), True)
    section = fault_section(subject)
    assert section is not None
    cells = section.tables[0].rows
    assert cells[0][1:6] == ["lighthouse-dark", "all", "0.2", "0.3", "0"]
    assert cells[1][1:5] == ["photodiode-dead (photodiodes 0, 5)", "craft-1, craft-2", "0.3", "the end"]


def test_kinds_of_faults_of_one_colour_are_told_apart_by_a_hatch() -> None:
    strikes = [Strike(i + 1, f"kind-{i}", (0,), i, i + 0.5, True) for i in range(len(faults.PALE) + 1)]
    series = SimpleNamespace(names=["a"], edges_s=(0.0, 12.0))
    drawn = faults._timeline(cast(Subject, SimpleNamespace(series=series, strikes=strikes))).files()["faults.svg"]
    hatches = re.findall(r"<pattern.*?</pattern>", drawn.decode(), re.DOTALL)
    assert hatches
    for hatch in hatches:
        assert "stroke: #ffffff" in hatch


def test_a_verdicts_sentence_is_on_its_card() -> None:
    verdict = {"name": "docking_lateral_at_contact_m", "value": 0.0132, "craft": "servicer", "min": None, "max": 0.01}
    (card,) = cards([{**verdict, "held": False, "about": ["servicer"], "why": "Blind since 52.6 s."}])
    assert (card.name, card.value, card.badge) == ("docking lateral at contact", "13.2 mm", "FAIL")
    assert card.meaning == "≤ 10 mm, servicer. Blind since 52.6 s."


def test_failed_cards_tell_limits_and_reason_once() -> None:
    """The limit in the card's unit alone, also beside a value far off; a shared reason on the first card only."""
    why = "no contact: blind since 5.0 s, 3 of 4 photodiodes lit, lost 0.50 m before the port"
    shared: dict[str, Any] = {"craft": None, "held": False, "about": []}
    height = {**shared, "name": "height_m", "value": 0.3, "min": -0.005, "max": 0.005}
    lateral = {**shared, "name": "docking_lateral_at_contact_m", "value": None, "min": None, "max": 0.01}
    first, second, third = cards(
        [
            {**height, "why": "probe at 9.0 s; no pose until then"},
            {**lateral, "why": why},
            {**lateral, "name": "docking_angle_at_contact_deg", "max": 2.0, "why": why},
        ]
    )
    assert (first.value, first.meaning) == ("300 mm", "-5 to 5 mm. Probe at 9.0 s; no pose until then")
    assert second.meaning == f"≤ 10 mm. N{why[1:]}"
    assert third.meaning == "≤ 2 °. For the same reason as docking lateral at contact"


def test_a_run_that_is_as_long_as_was_asked_is_not_called_short(tmp_path: Path) -> None:
    run = simulate(load("formation", ["duration_s=0.1", "swarm.count=2"]), out=tmp_path / "short", record=False)
    assert extent(Subject(run)) == "2 craft, 0.1 s flown"


def test_a_run_of_a_single_period_has_a_page(tmp_path: Path) -> None:
    run = simulate(load("formation", ["duration_s=0.01", "swarm.count=2"]), out=tmp_path / "one", record=False)
    assert run.summary["periods"] == 1
    first, last = Subject(run).series.edges_s
    assert first < 1 / 120 < last
    assert "2 craft" in words(run_page(Subject(run)))


def test_a_killed_run_has_the_extent_of_its_rows(tmp_path: Path) -> None:
    run = simulate(load("static", ["duration_s=0.5"]), out=tmp_path / "killed", record=False)
    scenario = run.folder / "scenario.toml"
    scenario.write_text(scenario.read_text().replace("duration_s = 0.5\n", "duration_s = 20.0\n"))
    kept = {key: value for key, value in run.summary.items() if key in ("program", "scenario", "seed")}
    (run.folder / "summary.json").write_text(json.dumps({**kept, "status": "running"}))
    page = words(run_page(Subject(open_run(run.folder))))
    assert "6 craft, only 0.5 s of 20 s flown" in page
    assert "This run is not complete" in page
    # The figures are computed from the rows, as at the end of a run.
    assert "Craft by craft" in page
    assert number(run.summary["swarm"]["ekf_position_rms_m"], scale=1000) + " mm" in page


def test_what_is_neither_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SwarmError, match="nothing is not a study or a run: there is no such folder"):
        write_report("nothing")


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (None, 3, "–"),
        (float("nan"), 3, "–"),
        (0, 3, "0"),
        (0.0012345, 3, "0.00123"),
        (2061.4, 2, "2100"),
        (99.96, 3, "100"),
        (16.6667, 3, "16.7"),
        (1234567, 3, "1\u202f230\u202f000"),
        (-1.5e-9, 3, "-1.50e-09"),
    ],
)
def test_numbers_have_significant_digits(value: float | None, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_a_gain_of_nothing_is_not_a_power_of_ten() -> None:
    assert percent(-7.5e-7) == "< 0.001 %"
    assert percent(0.0471) == "0.047 %"


def test_thinning_keeps_peaks_and_gaps() -> None:
    x = np.arange(20_000.0)
    y = np.zeros(20_000)
    y[12_345] = 7.0
    y[5_000:6_000] = np.nan
    few, peaks = thin(x, y, peaks=True)
    assert len(few) == len(peaks) <= 1500
    assert np.nanmax(peaks) == 7.0
    assert few[np.nanargmax(peaks)] == pytest.approx(12_345, abs=14)
    # A gap of 1000 samples is one of 1000 / 14 points, give or take an end.
    assert np.isnan(peaks).sum() == pytest.approx(1000 / 14, abs=2)
    same = thin(x[:100], y[:100])
    assert same[0] is not None
    np.testing.assert_array_equal(same[1], y[:100])

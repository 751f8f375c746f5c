"""Result folders that somebody has edited or damaged: a page, or one message that says what is wrong."""

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mutants import COUNT, HOSTILE, tracebacks

import swarm
from swarm.cli import app as cli
from swarm.errors import SwarmError
from swarm.report.page import html
from swarm.report.run import facts, run_page
from swarm.report.run_table import results
from swarm.report.subject import Subject
from swarm.report.write import write_report
from swarm.results.reading import read_telemetry
from swarm.results.run_folder import open_run
from swarm.results.summary_shape import check_summary
from swarm.results.table import TelemetryTable
from swarm.scenario import load
from swarm.studies.campaign.conduct import conduct
from swarm.studies.campaign.study import load_study
from swarm.studies.campaign.study_folder import open_study

TELEMETRY = "telemetry.parquet"


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with a criterion, and a small study."""
    folder = tmp_path_factory.mktemp("kept")
    criterion = 'criteria=[{measure="position_error_m", max=1.0}]'
    swarm.simulate(load("static", ["duration_s=0.3", criterion]), out=folder / "run", record=False)
    (folder / "small.toml").write_text(
        'base = "static"\noverrides = ["duration_s=0.1"]\n[grid]\nswarm.count = [1, 2]\n'
    )
    conduct(load_study(folder / "small.toml"), out=folder / "study", serial=True)
    return folder


@pytest.fixture
def run(kept: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(kept / "run", tmp_path / "run"))


@pytest.fixture
def study(kept: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(kept / "study", tmp_path / "study"))


@pytest.mark.long
def test_mutants_of_a_summary(run: Path) -> None:
    file = run / "summary.json"
    text = file.read_text()

    def read(mutant: str) -> None:
        file.write_bytes(mutant.encode("utf-8", "surrogatepass"))
        summary = open_run(run).summary
        check_summary(summary, str(file))
        # The terminal's table, and the parts of a page, of whatever was let in.
        results(summary, 80)
        facts(Subject(open_run(run)))

    assert tracebacks([text], read) == []


@pytest.mark.long
def test_mutants_of_a_studys_state_and_journal(study: Path) -> None:
    state, journal = study / "study.json", study / "journal.jsonl"
    rows = [json.dumps(row) + "\n" for row in open_study(study).rows.to_pylist()]
    good = state.read_text()

    def read_state(mutant: str) -> None:
        state.write_bytes(mutant.encode("utf-8", "surrogatepass"))
        open_study(study)

    def read_journal(mutant: str) -> None:
        journal.write_bytes(mutant.encode("utf-8", "surrogatepass"))
        open_study(study)

    assert tracebacks([good], read_state) == []
    state.write_text(good)
    assert tracebacks(["".join(rows)], read_journal) == []


def test_bytes_of_parquet_files_that_were_overwritten_or_cut(run: Path) -> None:
    file = run / TELEMETRY
    good = file.read_bytes()
    failed = []
    for number in range(COUNT // 10):
        rng = random.Random(number)
        data = bytearray(good)
        for _ in range(rng.choice((1, 3, 30))):
            # Thrift, which describes the columns, stands at the end.
            at = rng.randrange(len(data)) if rng.random() < 0.3 else len(data) - 1 - rng.randrange(min(4000, len(data)))
            data[at] = rng.randrange(256)
        file.write_bytes(data[: rng.randrange(len(data))] if rng.random() < 0.2 else data)
        try:
            rows = TelemetryTable.of(read_telemetry(run))
            rows.column("frame")
            rows.names_of("craft")
        except SwarmError:
            pass
        except Exception as error:
            failed.append((number, repr(error)))
    assert failed == []


def edit(run: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    pq.write_table(change(pq.read_table(run / TELEMETRY)), run / TELEMETRY)


def put(name: str, values: object) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.set_column(table.column_names.index(name), name, pa.array(values(len(table))))  # type: ignore[operator]


def folder_instead(path: Path) -> None:
    path.unlink()
    path.mkdir()


EDITS: dict[str, Callable[[Path], object]] = {
    "an empty summary": lambda run: (run / "summary.json").write_text(""),
    "a summary cut off": lambda run: (run / "summary.json").write_text((run / "summary.json").read_text()[:400]),
    "a summary in which words are numbers": lambda run: (run / "summary.json").write_text(
        (run / "summary.json").read_text().replace('"craft_count": 6', '"craft_count": "six"')
    ),
    "an empty table": lambda run: (run / TELEMETRY).write_bytes(b""),
    "a table cut off": lambda run: (run / TELEMETRY).write_bytes((run / TELEMETRY).read_bytes()[:3000]),
    "a folder in its place": lambda run: folder_instead(run / TELEMETRY),
    "no column frame": lambda run: edit(run, lambda table: table.drop_columns(["frame"])),
    "no column craft": lambda run: edit(run, lambda table: table.drop_columns(["craft"])),
    "no column visible": lambda run: edit(run, lambda table: table.drop_columns(["visible"])),
    "one column only": lambda run: edit(run, lambda table: table.select(["time_s"])),
    "words for times": lambda run: edit(run, put("time_s", lambda n: ["x"] * n)),
    "numbers for craft": lambda run: edit(run, put("craft", lambda n: list(range(n)))),
    "numbers for status": lambda run: edit(run, put("status", lambda n: [1.5] * n)),
    "no frame known": lambda run: edit(run, put("frame", lambda n: pa.nulls(n, pa.int32()))),
    "a frame far away": lambda run: edit(run, put("frame", lambda n: [0] * (n - 1) + [2_000_000_000])),
    "a scenario that is no text": lambda run: (run / "scenario.toml").write_bytes(b"\xff\xfe\x00"),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_run_is_one_message(
    run: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    EDITS[name](run)
    monkeypatch.setattr("sys.argv", ["swarm", "report", str(run)])
    assert cli.main() == 2
    errors = capsys.readouterr().err
    assert errors.count("error: ") == 1
    assert str(run) in errors
    assert "Traceback" not in errors
    assert not (run / "report.html").exists()


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    [
        put("position_error_m", lambda n: [np.inf] * n),
        put("nees", lambda n: [-1.0] * n),
        put("status", lambda n: ["tracking"] * n),
        lambda table: table.slice(0, 7),
        lambda table: table.slice(0, 0),
        lambda table: pa.concat_tables([table, table]),
        put("time_s", lambda n: list(range(n, 0, -1))),
    ],
)
def test_strange_numbers_still_make_a_page(run: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    edit(run, change)
    with np.errstate(all="ignore"):
        assert "<h1>Run: run</h1>" in html(run_page(Subject(open_run(run))))


@pytest.mark.parametrize("name", ["study.json", "study.toml", "runs.parquet"])
@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00", b"[1, 2", b"null", *(h.encode("utf-8", "replace") for h in HOSTILE[:8])]
)
def test_a_damaged_study_is_one_message_or_a_page(study: Path, name: str, content: bytes) -> None:
    (study / name).write_bytes(content)
    with pytest.raises(SwarmError) as caught:  # noqa: PT012
        write_report(study)
        raise SwarmError("made")
    assert str(caught.value)

"""The run's folder: never overwritten unasked, never a foreign file deleted, and always says what it is worth."""

import errno
import json
import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from synthetic_run import estimate_of, period_of, truth_at

from swarm.errors import PlaceError, SwarmError
from swarm.flight.simulate import simulate
from swarm.results.disk import outputs, refuse_existing, unwritten, write_all, write_text, writing
from swarm.results.files import PARTS
from swarm.results.parquet import TRIED_AGAIN, GrowingParquet, column, is_there, read_table, table_of
from swarm.results.run_folder import RunFolder, open_run, refuse_run
from swarm.results.run_writer import RunWriter
from swarm.results.telemetry import Telemetry
from swarm.scenario import load

FULL = Path("/dev/full")


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def fly(path, force=False, finish=True):
    with RunFolder(path, force) as run:
        run.write_scenario("seed = 7\n")
        telemetry = Telemetry(run.path, ["craft-0", "craft-1"])
        truth = truth_at(0.0, 2)
        telemetry.append(period_of(0.0, 0, truth, estimate_of(truth, np.random.default_rng(0))))
        run.recording.write_bytes(b"RRF2")
        if finish:
            telemetry.close()
            run.finish({"swarm": {"nees": None}})


def status(path):
    return json.loads((path / "summary.json").read_text())["status"]


def test_a_run_is_found_where_it_should_be_and_opens(tmp_path):
    with RunFolder.create("formation", 7) as folder:
        folder.finish({})
    assert folder.path == Path("runs/formation-7")
    fly(folder.path, force=True)
    for given in ("runs/formation-7", "formation-7", tmp_path / "runs" / "formation-7"):
        run = open_run(given)
        assert run.status == "complete"
        assert len(run.telemetry) == 2
        assert run.scenario == "seed = 7\n"
        assert run.summary["swarm"] == {"nees": None}
        assert run.recording is not None
    assert sorted(p.name for p in folder.path.iterdir()) == [
        "recording.rrd",
        "scenario.toml",
        "summary.json",
        "telemetry.parquet",
    ]


def test_out_is_taken_as_it_is(tmp_path):
    assert RunFolder.create("formation", 7, tmp_path / "deep" / "mine").path == tmp_path / "deep" / "mine"


def test_an_existing_run_needs_force(tmp_path):
    fly(tmp_path / "a")
    before = {p.name: p.read_bytes() for p in (tmp_path / "a").iterdir()}
    with pytest.raises(SwarmError, match=r"a holds a run already; --force"):
        RunFolder(tmp_path / "a")
    assert {p.name: p.read_bytes() for p in (tmp_path / "a").iterdir()} == before


def test_not_even_force_takes_a_folder_from_a_run_that_is_alive(tmp_path):
    with RunFolder(tmp_path / "a") as run:
        with pytest.raises(SwarmError, match="being written there now"):
            RunFolder(tmp_path / "a", force=True)
        run.finish({})
    fly(tmp_path / "a", force=True)


@pytest.mark.parametrize("finish", [True, False])
def test_force_replaces_the_run_and_nothing_else(tmp_path, finish):
    path = tmp_path / "a"
    with nullcontext() if finish else pytest.raises(RuntimeError, match="without a summary"):
        fly(path, finish=finish)
    (path / "notes.txt").write_text("mine")
    (path / "measured").mkdir()
    with RunFolder(path, force=True) as run:
        assert status(path) == "running"
        assert sorted(p.name for p in path.iterdir()) == ["measured", "notes.txt", "summary.json"]
        run.finish({})


@pytest.mark.parametrize("name", ["telemetry.parquet", "recording.rrd", "scenario.toml", "summary.json"])
def test_a_foreign_file_is_never_replaced_even_with_force(tmp_path, name):
    (tmp_path / name).write_text('{"mine": 1}')
    with pytest.raises(SwarmError, match=f"{name} was not written by lighthouse-swarm"):
        RunFolder(tmp_path, force=True)
    assert [p.name for p in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == '{"mine": 1}'


def test_foreign_files_among_the_parts_stay(tmp_path):
    fly(tmp_path / "a")
    (tmp_path / "a" / PARTS).mkdir()
    (tmp_path / "a" / PARTS / "mine.txt").write_text("mine")
    with pytest.raises(SwarmError, match="files that lighthouse-swarm did not write"):
        RunFolder(tmp_path / "a", force=True)
    assert (tmp_path / "a" / PARTS / "mine.txt").read_text() == "mine"


def test_a_folder_with_other_files_can_hold_a_run(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    fly(tmp_path)
    assert status(tmp_path) == "complete"


def test_a_stopped_run_says_why(tmp_path):
    with pytest.raises(KeyboardInterrupt), RunFolder(tmp_path / "a"):
        raise KeyboardInterrupt
    run = open_run(tmp_path / "a")
    assert (run.status, run.summary["reason"]) == ("interrupted", "stopped by the user")
    with pytest.raises(ValueError, match="boom"), RunFolder(tmp_path / "b"):
        raise ValueError("boom")
    assert open_run(tmp_path / "b").summary["reason"] == "ValueError: boom"
    assert len(open_run(tmp_path / "b").telemetry) == 0


def test_a_killed_run_stays_running_and_opens(tmp_path):
    code = (
        "import os, signal; from pathlib import Path; from swarm.results.run_folder import RunFolder\n"
        "with RunFolder(Path('k')) as run:\n"
        "    run.write_scenario('seed = 1')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    assert subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode == -9
    run = open_run(tmp_path / "k")
    assert (run.status, run.scenario, run.recording) == ("running", "seed = 1", None)
    with pytest.raises(SwarmError, match="--force"):
        RunFolder(tmp_path / "k")


def test_a_file_in_the_place_or_on_the_way(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(SwarmError, match="file: a file is in its place"):
        RunFolder(tmp_path / "file", force=True)
    with pytest.raises(SwarmError, match="a part of the path is a file"):
        RunFolder(tmp_path / "file" / "run")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere" / "at all")
    with pytest.raises(SwarmError, match="dangling"):
        RunFolder(tmp_path / "dangling")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_place_that_cannot_be_written(tmp_path, monkeypatch):
    def refuse(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    # Permission bits do not hold back the user that tests may run as.
    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(SwarmError, match=r"locked: no permission to write there; choose another place$"):
        RunFolder(tmp_path / "locked")


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")
def test_a_full_disk_leaves_the_old_file(tmp_path):
    write_text(tmp_path / "summary.json", "old")
    (tmp_path / "summary.json.tmp").symlink_to(FULL)
    with pytest.raises(SwarmError, match=r"summary\.json: the disk is full"):
        write_text(tmp_path / "summary.json", "new")
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]
    assert (tmp_path / "summary.json").read_text() == "old"


@pytest.fixture
def full_disk(monkeypatch):
    """Lets nobody write a new file: what is on the disk can be read, and written over."""

    def refuse(path, *_args, **_kwargs):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    return lambda: monkeypatch.setattr(Path, "write_text", refuse)


def test_a_library_that_finds_the_disk_full_says_so_in_the_same_words(tmp_path, monkeypatch):
    with pytest.raises(SwarmError) as ours, writing(tmp_path):
        raise OSError(errno.ENOSPC, "full")
    said = "Failed to encode LogMsg: Failed to write: No space left on device (os error 28)"
    assert str(unwritten(tmp_path, RuntimeError(said))) == str(ours.value)
    assert str(unwritten(tmp_path, RuntimeError("broken"))) == f"cannot write {tmp_path}: broken"
    # rerun says why its thread has ended only in a log.
    monkeypatch.setattr("swarm.results.disk.disk_usage", lambda _path: SimpleNamespace(free=4096))
    assert str(unwritten(tmp_path, RuntimeError("thread shut down prematurely"))) == str(ours.value)


@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
def test_a_recording_that_cannot_grow_is_one_message_without_lines_of_a_log(tmp_path):
    code = """
import resource
from pathlib import Path
import numpy as np
from swarm.errors import SwarmError
from swarm.results.recording import canvas as of_canvas
from swarm.results.recording.canvas import Canvas, rr
of_canvas.PATIENCE_S = 1.0
canvas = Canvas(Path("full.rrd"), live=False)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
canvas.static("noise", rr.Scalars(np.random.default_rng(1).normal(size=50_000)))
for _ in range(2):
    try:
        canvas.flush()
    except SwarmError as error:
        print(error)
canvas.close()
"""
    root = str(Path(__file__).parents[1])
    environment = {key: value for key, value in os.environ.items() if key != "RUST_LOG"} | {"PYTHONPATH": root}
    ended = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert ended.stdout.startswith("cannot write full.rrd: ")
    assert ended.stderr == ""


@pytest.mark.parametrize(
    ("joined_rows", "what"), [(0, "pathlib.Path.open"), (1000, "pyarrow.parquet.ParquetWriter.write_table")]
)
def test_an_end_that_fails_leaves_the_groups_and_nothing_else(tmp_path, monkeypatch, joined_rows, what):
    table = table_of([column("x", [1.0, 2.0], "m")])
    growing = GrowingParquet(tmp_path / "x.parquet", table.schema, joined_rows)
    growing.write(table)
    size = (tmp_path / "x.parquet.partial" / "rows").stat().st_size

    def refuse(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, "full")

    with monkeypatch.context() as full:
        full.setattr(what, refuse)
        with pytest.raises(SwarmError, match=r"x\.parquet: the disk is full"):
            growing.close()
    assert {file.name for file in (tmp_path / "x.parquet.partial").iterdir()} == {"part-00000.footer", "rows"}
    assert (tmp_path / "x.parquet.partial" / "rows").stat().st_size == size
    assert read_table(tmp_path / "x.parquet")["x"].to_pylist() == [1.0, 2.0]
    growing.close()
    assert [file.name for file in tmp_path.iterdir()] == ["x.parquet"]
    assert pq.read_table(tmp_path / "x.parquet")["x"].to_pylist() == [1.0, 2.0]


def test_a_group_that_found_no_room_is_no_part_of_the_file(tmp_path, monkeypatch):
    """Half of it may be on the disk: the next one is written over it."""
    table = table_of([column("x", [1.0, 2.0], "m")])
    growing = GrowingParquet(tmp_path / "x.parquet", table.schema)
    growing.write(table)
    write = pq.ParquetWriter.write_table

    def half(self, *args, **named):
        write(self, *args, **named)
        raise OSError(errno.ENOSPC, "full")

    with monkeypatch.context() as full:
        full.setattr(pq.ParquetWriter, "write_table", half)
        with pytest.raises(SwarmError, match="the disk is full"):
            growing.write(table)
    assert read_table(tmp_path / "x.parquet")["x"].to_pylist() == [1.0, 2.0]
    growing.write(table, 0)
    growing.write(table_of([column("x", [3.0], "m")]))
    growing.close()
    whole = pq.ParquetFile(tmp_path / "x.parquet")
    assert whole.read()["x"].to_pylist() == [1.0, 2.0, 3.0]
    assert whole.metadata.num_row_groups == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "full")])
def test_files_of_one_result_appear_together_or_not_at_all(tmp_path, error):
    old, new = tmp_path / "kept" / "a.txt", tmp_path / "kept" / "b.txt"
    write_all({old: b"old"})

    def half(folder):
        with outputs(folder / "a.txt", folder / "b.txt") as temporaries:
            temporaries[0].write_text("half of ")
            raise error

    for folder in (tmp_path / "kept", tmp_path / "x" / "y"):
        with pytest.raises((KeyboardInterrupt, SwarmError), match=r"^$|^cannot write .*: the disk is full"):
            half(folder)
    assert [file.name for file in tmp_path.rglob("*")] == ["kept", "a.txt"]
    assert old.read_text() == "old"
    write_all({old: b"1", new: b"2"})
    assert (old.read_text(), new.read_text()) == ("1", "2")


def test_a_stop_between_two_files_comes_after_the_second(tmp_path, monkeypatch):
    def stopped(file, target):
        monkeypatch.undo()
        file.replace(target)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        write_all({tmp_path / "a": b"1", tmp_path / "b": b"2"})
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a", "b"]


def test_a_place_that_is_closed_is_told_before_the_work(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.raises(SwarmError, match="a part of the path is a file"):
        refuse_existing(tmp_path / "file" / "x" / "out.txt", force=True)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(SwarmError, match=r"out\.txt: no permission to write there; choose another place$"):
        refuse_existing(tmp_path / "new" / "out.txt", force=False)
    with pytest.raises(SwarmError, match=r"new/run: no permission to write there; choose another place$"):
        refuse_run("formation", 7, tmp_path / "new" / "run")


def test_a_flight_onto_a_full_disk_says_how_much_of_it_is_kept_and_what_to_do(tmp_path, monkeypatch):
    flown: list[object] = []

    def until_full(writer, period):
        with writing(tmp_path / "r" / "telemetry.parquet"):
            if len(flown) == 120:
                raise OSError(errno.ENOSPC, "full")
        flown.append(period)
        append(writer, period)

    append = RunWriter.append
    monkeypatch.setattr(RunWriter, "append", until_full)
    settings = load("formation", ["duration_s=3", "swarm.count=1", "recording.enabled=false"])
    with pytest.raises(PlaceError) as full:
        simulate(settings, out=tmp_path / "r")
    run = open_run(tmp_path / "r")
    assert run.summary["duration_s"] == pytest.approx(120 / 60, abs=0.02)
    assert str(full.value) == (
        f"cannot write {tmp_path / 'r' / 'telemetry.parquet'}: the disk is full; what was written before stays "
        "readable, 2.0 s of flight; free some room, or choose another place"
    )


def test_a_run_that_ends_on_a_full_disk_says_so_in_its_summary(tmp_path, full_disk):
    path = tmp_path / "r"
    folder = RunFolder(path)
    full_disk()
    with pytest.raises(SwarmError, match="no room for the telemetry"), folder:
        raise SwarmError("no room for the telemetry")
    run = open_run(path)
    assert (run.status, run.summary["reason"]) == ("interrupted", "no room for the telemetry")


@pytest.mark.parametrize("figures", [{"periods": 7}, {"periods": 7, "craft": ["a" * 30] * 4000}])
def test_the_figures_of_a_run_that_ends_on_a_full_disk_are_kept_if_they_fit(tmp_path, full_disk, figures):
    with RunFolder(tmp_path / "r") as folder:
        full_disk()
        folder.interrupt("the disk is full", figures)
    run = open_run(tmp_path / "r")
    assert (run.status, run.summary["reason"]) == ("interrupted", "the disk is full")
    assert run.summary.get("periods") == (7 if "craft" not in figures else None)


def test_a_run_that_is_complete_when_the_disk_is_full_is_complete(tmp_path, full_disk):
    with RunFolder(tmp_path / "r") as folder:
        full_disk()
        folder.finish({"periods": 7})
    assert (open_run(tmp_path / "r").status, open_run(tmp_path / "r").summary["periods"]) == ("complete", 7)


def test_a_summary_never_holds_nan(tmp_path):
    run = RunFolder(tmp_path / "a")
    with pytest.raises(ValueError, match="null"):
        run.finish({"nees": float("nan")})
    assert status(tmp_path / "a") == "running"


def test_what_is_not_a_run_says_so_and_names_the_nearest(tmp_path):
    fly(tmp_path / "runs" / "formation-7")
    with pytest.raises(SwarmError, match=r"runs/formatoin-7 is not a run: there is no such folder.*did you mean"):
        open_run("runs/formatoin-7")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SwarmError, match=r"it has no summary\.json"):
        open_run(tmp_path / "empty")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "summary.json").write_text("{")
    with pytest.raises(SwarmError, match=r"summary\.json is damaged"):
        open_run(tmp_path / "bad")


def test_force_touches_no_link_and_no_file_that_is_not_a_runs(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "part-00000.arrow").write_text("mine")
    place = tmp_path / "run"
    fly(place)
    (place / "angles.parquet.partial").symlink_to(elsewhere)
    with pytest.raises(SwarmError, match=r"angles\.parquet\.partial is a link, which lighthouse-swarm does not make"):
        RunFolder(place, force=True)
    assert status(place) == "complete"
    (place / "angles.parquet.partial").unlink()
    (place / "angles.parquet.partial").mkdir()
    (place / "angles.parquet.partial" / "notes.txt").write_text("mine")
    with pytest.raises(SwarmError, match="holds files that lighthouse-swarm did not write"):
        RunFolder(place, force=True)
    assert (elsewhere / "part-00000.arrow").read_text() == "mine"
    # Without a marker of ours, a link that leads nowhere is in the way too.
    other = tmp_path / "other"
    other.mkdir()
    (other / "scans.parquet").symlink_to(tmp_path / "nowhere")
    with pytest.raises(SwarmError, match=r"scans\.parquet was not written by lighthouse-swarm"):
        RunFolder(other)
    assert (other / "scans.parquet").is_symlink()


def test_a_table_that_grows_can_be_read_before_it_is_complete(tmp_path):
    file = tmp_path / "scans.parquet"
    part = pa.table({"time_s": [1.0, 2.0], "observer": ["a", "b"]})
    growing = GrowingParquet(file, part.schema)
    assert not is_there(file)
    growing.write(part)
    growing.write(part)
    assert not file.exists()
    assert is_there(file)
    assert read_table(file)["time_s"].to_pylist() == [1.0, 2.0, 1.0, 2.0]
    assert read_table(file, ["observer"]).column_names == ["observer"]
    growing.close()
    assert [path.name for path in tmp_path.iterdir()] == ["scans.parquet"]
    assert read_table(file)["observer"].to_pylist() == ["a", "b", "a", "b"]


def test_only_columns_that_get_smaller_are_compressed(tmp_path):
    rng, rows, file = np.random.default_rng(0), 4096, tmp_path / "x.parquet"
    still, noise = np.full(rows, 0.25), rng.standard_normal(rows)

    def part(changing):
        return table_of([column("still", still, "m"), column("changing", changing, "m")])

    growing = GrowingParquet(file, part(noise).schema, split=["still", "changing"], use_dictionary=False)
    # Noise comes to rest in the third group, which is seen when every column is tried again.
    groups = [part(noise if k < 2 else still) for k in range(TRIED_AGAIN + 2)]
    for group in groups:
        growing.write(group)
    growing.close()
    assert read_table(file).equals(pa.concat_tables(groups))
    about = pq.ParquetFile(file).metadata
    compressed = [[about.row_group(k).column(i).compression == "SNAPPY" for k in range(len(groups))] for i in (0, 1)]
    assert compressed[0] == [True] * len(groups)
    assert compressed[1] == [True] + [False] * (TRIED_AGAIN - 1) + [True, True]


def test_telemetry_that_is_gone_is_not_a_run_without_a_period(tmp_path):
    run = simulate(load("static", ["duration_s=0.1"]), out=tmp_path / "run", record=False)
    (run.folder / "telemetry.parquet").unlink()
    with pytest.raises(SwarmError, match=r"cannot read the telemetry in .*run: telemetry\.parquet is missing"):
        open_run(run.folder).telemetry  # noqa: B018
    # Work that was killed at its beginning has none.
    (run.folder / "summary.json").write_text('{"program": "lighthouse-swarm", "status": "running"}')
    assert len(open_run(run.folder).telemetry) == 0


def test_the_page_of_a_run_goes_with_it(tmp_path):
    fly(tmp_path / "run")
    (tmp_path / "run" / "report.html").write_text("<html></html>")
    (tmp_path / "run" / "figures").mkdir()
    (tmp_path / "run" / "figures" / "errors.svg").write_text("<svg/>")
    fly(tmp_path / "run", force=True)
    assert not (tmp_path / "run" / "report.html").exists()
    assert not (tmp_path / "run" / "figures").exists()
    (tmp_path / "run" / "figures").mkdir()
    (tmp_path / "run" / "figures" / "mine.txt").write_text("notes")
    with pytest.raises(SwarmError, match="figures holds files that lighthouse-swarm did not write"):
        fly(tmp_path / "run", force=True)
    assert (tmp_path / "run" / "telemetry.parquet").is_file()

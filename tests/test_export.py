"""swarm export: files read back have the telemetry's numbers, in the frames and the times that they name.

`python benchmarks/exports.py` reads them with evo, oem and ccsds-ndm.
"""

import csv
import json
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from estimators.relative_orbit import BORESIGHTS
from estimators.rotation import exp, matrix_from_quaternion, quaternion_from_matrix, wxyz_from_xyzw
from swarm.cli import app as cli
from swarm.errors import SwarmError
from swarm.exports import mcap_file
from swarm.exports.ccsds import TimeSystem, aem, epoch, oem
from swarm.exports.export import Exported, Format, export
from swarm.exports.kitti import common
from swarm.exports.trajectory import Source, Trajectories, Trajectory
from swarm.exports.tum import tum
from swarm.flight.simulate import simulate
from swarm.results.disk import replacing
from swarm.results.run_folder import Run
from swarm.scenario import load

START = "2027-03-01T23:59:59.95"
Command = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Three craft in an orbit, for a quarter of a second."""
    changes = {"duration_s": 0.25, "craft[0].motion": {"kind": "hold", "position_m": [0.3, 0.2, 6.0]}}
    return simulate(load("orbit", changes), out=tmp_path_factory.mktemp("runs") / "orbit", record=False)


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    monkeypatch.chdir(tmp_path)

    def swarm(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["swarm", *arguments])
        return cli.main(), *capsys.readouterr()

    return swarm


def written(run: Run, to: Format, tmp_path: Path) -> Exported:
    return export(run.folder, to, out=tmp_path / to, start=epoch(START) if to is Format.CCSDS else None)


def made(frames: list[int], **more: object) -> Trajectory:
    """A trajectory of one craft in these periods, of random poses."""
    draw, n = np.random.default_rng(3), len(frames)
    turn = quaternion_from_matrix(exp(draw.normal(size=(n, 3))))
    base = Trajectory(
        "a", Source.TRUTH, np.array(frames), np.array(frames) / 60, draw.normal(size=(n, 3)), turn, None, None, None
    )
    return base._replace(**more)  # type: ignore[arg-type]


def messages(file: Path) -> list[tuple[dict[str, str], list[list[str]]]]:
    """Return the segments of an OEM or AEM: metadata, and the rows of numbers with their epochs."""
    out: list[tuple[dict[str, str], list[list[str]]]] = []
    inside = False
    for line in file.read_text().splitlines():
        if line in ("META_START", "META_STOP"):
            inside = line == "META_START"
            if inside:
                out.append(({}, []))
        elif inside:
            key, _, value = line.partition(" = ")
            out[-1][0][key] = value
        elif line[:1].isdigit():
            out[-1][1].append(line.split())
    return out


def test_tum_gives_the_errors_of_the_summary(run: Run, tmp_path: Path) -> None:
    folder = written(run, Format.TUM, tmp_path).folder
    for name, figures in run.summary["craft"].items():
        truth, estimate = (np.loadtxt(folder / f"{name}.{source}.tum") for source in ("truth", "estimate"))
        both = np.isin(truth[:, 0], estimate[:, 0])
        error = np.linalg.norm(truth[both, 1:4] - estimate[:, 1:4], axis=1)
        assert np.sqrt(np.mean(error**2)) == pytest.approx(figures["ekf_position_rms_m"], abs=1e-9)
        turns = [matrix_from_quaternion(wxyz_from_xyzw(rows[:, 4:])) for rows in (truth[both], estimate)]
        angle = np.degrees(np.arccos((np.trace(np.swapaxes(turns[0], 1, 2) @ turns[1], axis1=1, axis2=2) - 1) / 2))
        assert np.sqrt(np.mean(angle**2)) == pytest.approx(figures["ekf_attitude_rms_deg"], abs=1e-6)


def test_kitti_files_have_the_same_periods_in_the_same_lines(run: Run, tmp_path: Path) -> None:
    folder = written(run, Format.KITTI, tmp_path).folder
    one = Trajectories(run.folder).of("keeper", Source.TRUTH)
    rows = np.loadtxt(folder / "keeper.truth.kitti").reshape(-1, 3, 4)
    times = np.loadtxt(folder / "keeper.times.txt")
    chosen = np.isin(one.time_s, times)
    assert np.array_equal(rows[:, :, 3], one.position[chosen])
    assert np.allclose(rows[:, :, :3], matrix_from_quaternion(one.quaternion[chosen]), atol=1e-15)
    kept = common([made([0, 1, 2, 5]), made([1, 2, 4, 5])])
    assert [each.frame.tolist() for each in kept] == [[1, 2, 5]] * 2


def test_csv_has_units_and_every_digit(run: Run, tmp_path: Path) -> None:
    file = written(run, Format.CSV, tmp_path).folder / "visitor.estimate.csv"
    with file.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    one = Trajectories(run.folder).of("visitor", Source.ESTIMATE)
    assert one.velocity is not None
    assert one.sigma is not None
    assert [float(row["pz_m"]) for row in rows] == one.position[:, 2].tolist()
    assert [float(row["vx_m_s"]) for row in rows] == one.velocity[:, 0].tolist()
    assert [float(row["attitude_sigma_deg"]) for row in rows] == one.sigma[:, 1].tolist()


def test_ccsds_is_in_lvlh_axes_and_dated(run: Run, tmp_path: Path) -> None:
    folder = written(run, Format.CCSDS, tmp_path).folder
    one = Trajectories(run.folder).of("visitor", Source.TRUTH)
    assert one.velocity is not None
    ((meta, rows),) = messages(folder / "visitor.truth.oem")
    assert meta["REF_FRAME"] == "LVLH_ROTATING"
    assert meta["TIME_SYSTEM"] == "UTC"
    assert (meta["START_TIME"], meta["STOP_TIME"]) == (rows[0][0], rows[-1][0])
    # The lighthouse looks along -V-bar with R-bar down: what is ahead of it is behind in the orbit, below stays below.
    ours = np.concatenate([one.position, one.velocity], axis=1)
    there = 1e3 * np.array([row[1:] for row in rows], dtype=np.float64)
    assert np.allclose(there[:, :3], np.stack([-ours[:, 2], -ours[:, 0], ours[:, 1]], axis=1), rtol=0, atol=1e-12)
    assert np.allclose(there[:, 3:], np.stack([-ours[:, 5], -ours[:, 3], ours[:, 4]], axis=1), rtol=0, atol=1e-12)
    start = datetime.fromisoformat(START)
    for row, time_s in zip(rows, one.time_s.tolist(), strict=True):
        assert (datetime.fromisoformat(row[0][:26]) - start).total_seconds() == pytest.approx(time_s, abs=1e-6)
    assert rows[-1][0].startswith("2027-03-02T00:00:00.")


def test_an_attitude_takes_frame_a_to_the_body(run: Run, tmp_path: Path) -> None:
    """The direction cosines of the Blue Book, from the quaternion, turn the components of a vector into the body's."""
    folder = written(run, Format.CCSDS, tmp_path).folder
    one = Trajectories(run.folder).of("visitor", Source.TRUTH)
    ((meta, rows),) = messages(folder / "visitor.truth.aem")
    assert meta["ATTITUDE_DIR"] == "A2B"
    q = np.array([row[1:] for row in rows], dtype=np.float64)
    assert (np.sum(q[1:] * q[:-1], axis=1) > 0).all()
    x, y, z, w = q[0]
    cosines = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y + z * w), 2 * (x * z - y * w)],
            [2 * (x * y - z * w), w * w - x * x + y * y - z * z, 2 * (y * z + x * w)],
            [2 * (x * z + y * w), 2 * (y * z - x * w), w * w - x * x - y * y + z * z],
        ]
    )
    body = matrix_from_quaternion(one.quaternion[0])
    v_lighthouse = np.array([0.3, -1.0, 2.0])
    v_orbit = BORESIGHTS["-v-bar"].T @ v_lighthouse
    assert np.allclose(cosines @ v_orbit, body.T @ v_lighthouse, atol=1e-12)


def test_a_gap_begins_a_new_segment(tmp_path: Path) -> None:
    one = made([0, 1, 2, 7, 8])
    one = one._replace(velocity=np.where(np.arange(5)[:, None] == 0, np.nan, one.position))
    file = tmp_path / "a.oem"
    file.write_text("\n".join(oem(one, epoch(START), None)))
    found = messages(file)
    assert [len(rows) for _, rows in found] == [2, 2]
    assert found[0][0]["REF_FRAME"] == "LIGHTHOUSE"
    file.write_text("\n".join(aem(one, epoch(START), None)))
    assert [len(rows) for _, rows in messages(file)] == [3, 2]


def test_mcap_is_read_back(run: Run, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="needs the extra mcap")
    start = epoch(START)
    done = export(run.folder, Format.MCAP, [Source.TRUTH], craft=["keeper"], start=start, out=tmp_path)
    one = Trajectories(run.folder).of("keeper", Source.TRUTH)
    with done.files[0].open("rb") as stream:
        found = list(reader.make_reader(stream).iter_messages(topics=["/keeper/truth"]))
        stream.seek(0)
        attached = {each.name for each in reader.make_reader(stream).iter_attachments()}
    places = [json.loads(message.data)["pose"]["position"] for _, _, message in found]
    assert [[place[axis] for axis in "xyz"] for place in places] == one.position.tolist()
    assert {schema.name for schema, _, _ in found} == {"foxglove.PoseInFrame"}
    assert found[0][2].log_time == start.unix_ns(float(one.time_s[0]))
    assert {"scenario.toml", "summary.json"} <= attached


def test_without_the_library_mcap_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mcap", None)
    with pytest.raises(SwarmError, match=r"pip install \'\.\[mcap\]\'"):
        mcap_file.check_library()


def test_numbers_are_read_again_as_they_were() -> None:
    one = made([0, 1])
    rows = [line.split() for line in tum(one) if not line.startswith("#")]
    assert np.array_equal(np.array(rows, dtype=np.float64)[:, 1:4], one.position)


@pytest.mark.parametrize(
    ("text", "written_as"),
    [("2027-03-01T12:00:00", "12:00:00.250000000"), ("2027-03-01T12:00:00.9Z", "12:00:01.150000000")],
)
def test_epochs(text: str, written_as: str) -> None:
    assert epoch(text).after(0.25).endswith(written_as)
    assert epoch(text).unix_ns(0.0) == round(
        datetime.fromisoformat(f"{text.removesuffix('Z')}+00:00").timestamp() * 1e9
    )


@pytest.mark.parametrize("text", ["noon", "2027-03-01", "2027-03-01T12:00:00+01:00", "2027-02-30T00:00:00", "1e400"])
def test_what_is_no_epoch(text: str) -> None:
    with pytest.raises(SwarmError, match="--epoch"):
        epoch(text)
    with pytest.raises(SwarmError, match="means UTC"):
        epoch("2027-03-01T12:00:00Z", TimeSystem.TAI)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--to ccsds", "--epoch"),
        ("--to tum --epoch 2027-03-01T12:00:00", "seconds from the start"),
        ("--to tum --what smoothed", "swarm smooth makes it"),
        ("--to tum --what peer", "only a replay has it"),
        ("--to tum --craft keper", "did you mean 'keeper'"),
        ("--to ccsds --epoch 2027-03-01T12:00:00 --what pnp", "needs velocities"),
        ("--to tim", "--to"),
    ],
)
def test_mistakes(command: Command, run: Run, arguments: str, message: str) -> None:
    code, out, err = command("export", str(run.folder), *arguments.split(), "--out", "there")
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not any(Path("there").glob("*"))


def test_nothing_is_replaced_unless_asked(command: Command, run: Run) -> None:
    arguments = ("export", str(run.folder), "--to", "csv", "--craft", "keeper", "--out", "there")
    assert command(*arguments)[0] == 0
    Path("there/keeper.truth.csv").write_text("mine")
    code, _, err = command(*arguments)
    assert code == 2
    assert "is there already; --force" in err
    assert Path("there/keeper.truth.csv").read_text() == "mine"
    assert command(*arguments, "--force")[0] == 0
    assert Path("there/keeper.truth.csv").read_text() != "mine"


def fail_while_writing(path: Path, stop: BaseException) -> None:
    with replacing(path) as file:
        file.write_text("half")
        raise stop


def test_a_file_that_cannot_be_completed_leaves_nothing(tmp_path: Path) -> None:
    for stop in (OSError(28, "No space left on device"), KeyboardInterrupt()):
        (tmp_path / "a.tum").write_text("old\n")
        with pytest.raises((SwarmError, KeyboardInterrupt)):
            fail_while_writing(tmp_path / "a.tum", stop)
        assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("a.tum", "old\n")]
    with replacing(tmp_path / "a.tum") as file:
        file.write_text("new\n")
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("a.tum", "new\n")]

"""A replay finds the noise of a recording by itself, and leaves out what contradicts the rest."""

import tomllib
from pathlib import Path

import made_recording
import numpy as np
import pytest
from made_recording import Made, true_in_station
from synthetic_recording import calibration_text

import swarm
from estimators.arrays import Floats, Ints
from estimators.lighthouse.integrity import Sweeps
from estimators.lighthouse.sweep import ideal_theta
from swarm.assets import recordings
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.recordings.consistency import Consistency, Sample, assess
from swarm.flight.recordings.contents import contents
from swarm.results.run_folder import Run
from swarm.scenario import for_replay

SHORT = Made(duration_s=5.0)
LIAR = 13
"""A photodiode that station 0 sees through the whole short recording."""


def replayed(folder: Path, made: Made, *overrides: str, **options: object) -> tuple[Run, list[str]]:
    file = made_recording.write(folder / "made.rec.gz", made_recording.lines(made))
    (folder / "made.json").write_text(calibration_text())
    notes: list[str] = []
    run = swarm.replay(
        file,
        calibration=folder / "made.json",
        scenario=for_replay(file, overrides),
        out=folder / "run",
        force=True,
        record=False,
        tell=notes.append,
        **{"lighthouse": 0, **options},  # type: ignore[arg-type]
    )
    assert run.telemetry.num_rows, "read before the folder is written again"
    return run, notes


def errors_m(run: Run) -> Floats:
    """Distances of the poses of PnP from the truth, in the periods that have one."""
    table = run.telemetry
    solved = np.stack([table[f"pnp_{key}"].to_numpy() for key in ("px_m", "py_m", "pz_m")], axis=1)
    # Station 0 sweeps in the second turn of a period, and the epoch is in the middle of it.
    epoch_s = table["time_s"].to_numpy() + 1.5 / 60 + 20_000 / 48e6
    out: Floats = np.linalg.norm(solved - true_in_station(0, epoch_s)[1], axis=1)
    return out[np.isfinite(out)]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Floats:
    return errors_m(replayed(tmp_path_factory.mktemp("clean"), SHORT)[0])


def test_a_constant_reflection_is_left_out_and_named(tmp_path: Path, clean: Floats) -> None:
    run, notes = replayed(tmp_path, SHORT._replace(liar=(LIAR, 0, 4.7e-3)))
    found = errors_m(run)
    assert np.median(clean) < 5e-3
    assert np.median(found) < 1.5 * np.median(clean) + 1e-3
    assert any(f"photodiode {LIAR} contradicts the others in 100 %" in note for note in notes)
    dropped = run.telemetry["dropped_photodiodes"].to_numpy()
    assert np.mean(dropped[15:] == 1) > 0.95, "it is seen from the 14th period on"
    assert run.summary["swarm"]["integrity"]["mean_dropped_photodiodes"] > 0.85
    assert run.summary["swarm"]["residual_median_rad"] < 100e-6
    believing, _ = replayed(
        tmp_path, SHORT._replace(liar=(LIAR, 0, 4.7e-3)), "navigation.integrity.residual_test=false"
    )
    assert np.median(errors_m(believing)) > 5 * np.median(found)


@pytest.mark.parametrize("noise_rad", [40e-6, 200e-6])
def test_the_noise_is_taken_from_the_recording(tmp_path: Path, noise_rad: float) -> None:
    made = SHORT._replace(own_rad=noise_rad, rotor_rad=1e-6, misplaced_m=0.0)
    run, notes = replayed(tmp_path, made)
    assert run.scenario is not None
    found = np.radians(tomllib.loads(run.scenario)["navigation"]["angle_noise_arcsec"] / 3600) * np.sqrt(0.5)
    assert found == pytest.approx(noise_rad, rel=0.15)
    agree = next(float(note.split("agree to ")[1].split()[0]) for note in notes if "the angles agree to" in note)
    # Rounding to ticks is in what was found, and the craft add that of their own clock: it counts once.
    assumed = np.hypot(found, builders.timing_noise(for_replay(tmp_path / "made.rec.gz")).own_rad)
    assert assumed == pytest.approx(np.radians(agree / 3600), abs=np.radians(0.051 / 3600))
    assert run.summary["swarm"]["integrity"]["failed_residual_test_share"] < 0.01
    told, notes = replayed(tmp_path, made, "navigation.angle_noise_arcsec=77")
    assert "angle_noise_arcsec = 77" in (told.scenario or "")
    assert not any("agree" in note for note in notes)


def test_of_two_pulses_the_expected_one_is_chosen(tmp_path: Path, clean: Floats) -> None:
    run, _ = replayed(tmp_path, SHORT._replace(echo=0.5))
    whole, _ = replayed(tmp_path, SHORT)
    visible, all_visible = (r.telemetry["visible"].to_numpy()[10:].mean() for r in (run, whole))
    assert visible > 0.98 * all_visible, "dropping both would leave a quarter: both fans must have one pulse"
    assert np.median(errors_m(run)) < 1.3 * np.median(clean)
    assert run.telemetry["rejected_pulses"].to_numpy()[10:].mean() > 2


def sample(rng: np.random.Generator, noise_rad: float, false: Ints, photodiodes: int) -> Sample:
    point = 0.1 * rng.permutation(made_recording.layout())[:photodiodes]
    rotation, position = np.eye(3)[None], np.array([[0.1, -0.2, 2.0]])
    theta = ideal_theta(point + position)[None] + rng.normal(0, noise_rad, (1, photodiodes, 2))
    theta[0, false, 0] += 5e-3
    rest, lit = np.zeros((1, 3)), np.ones((1, photodiodes), dtype=np.bool_)
    sweeps = Sweeps(theta, lit, point[None], np.zeros((1, photodiodes, 2)), rest, rest)
    return Sample(sweeps, rotation, position)


def found(noise_rad: float, false: list[int], photodiodes: int, periods: int = 60) -> Consistency:
    rng = np.random.default_rng(11)
    return assess(sample(rng, noise_rad, np.array(false, dtype=int), photodiodes) for _ in range(periods))


@pytest.mark.parametrize("noise_rad", [20e-6, 300e-6])
@pytest.mark.parametrize("photodiodes", [5, 6, 8, 14])
def test_noise_of_honest_angles_is_found_whatever_their_number(noise_rad: float, photodiodes: int) -> None:
    told = found(noise_rad, [], photodiodes)
    assert told.noise_rad == pytest.approx(noise_rad, rel=0.15)
    assert len(told.false) == 0


@pytest.mark.parametrize(("false", "photodiodes"), [([2], 7), ([0], 12), ([1, 4], 8), ([3, 9], 14)])
def test_false_photodiodes_do_not_raise_the_noise(false: list[int], photodiodes: int) -> None:
    told = found(50e-6, false, photodiodes)
    assert told.noise_rad == pytest.approx(50e-6, rel=0.2)
    assert told.false.tolist() == false
    assert np.all(told.share > 0.9)


def test_too_little_light_tells_nothing(tmp_path: Path) -> None:
    assert found(50e-6, [], 12, periods=10).noise_rad is None
    assert found(50e-6, [], 4).noise_rad is None
    _, notes = replayed(tmp_path, SHORT._replace(duration_s=0.6))
    assert any("the noise is guessed, 20 arcsec, and residuals are not tested" in note for note in notes)


# What is in a recording, and the one that comes with the program.


def test_contents_and_the_choice_of_the_object(tmp_path: Path) -> None:
    text = made_recording.lines(SHORT._replace(duration_s=1.0))
    config = next(line for line in text if "CONFIG" in line)
    dark = [config.replace("WAND", "DARK")]
    second = [config.replace("WAND", "NEW"), "0.4 NEW W 10 7 2593609211 1"]
    file = made_recording.write(tmp_path / "some.rec.gz", text + dark + second)
    rows = contents(file).rows
    assert [(r.name, r.generation, r.station, r.remark) for r in rows] == [
        ("WAND", "1.0", 0, ""),
        ("WAND", "1.0", 1, ""),
        ("DARK", "", None, "saw no light"),
        ("NEW", "2.0", None, "no hit with its rotor's zero"),
    ]
    assert rows[0].photodiodes == 20
    assert (rows[0].pulses, rows[0].angles) == (30, 30)
    assert rows[0].end_s == pytest.approx(2.0, abs=0.1)
    run = swarm.replay(file, out=tmp_path / "run", record=False)
    assert run.telemetry["craft"][0].as_py() == "WAND"
    both = [line.replace("WAND", "WAN2") for line in text]
    made_recording.write(file, text + both)
    with pytest.raises(SwarmError, match="2 objects saw light, choose one: --object WAND, --object WAN2"):
        swarm.replay(file, out=tmp_path / "none")
    made_recording.write(file, dark + second)
    with pytest.raises(SwarmError, match="no hit with its rotor's zero"):
        swarm.replay(file, out=tmp_path / "none")


def test_the_shipped_recording_is_small_and_replayed_well(tmp_path: Path) -> None:
    file = recordings()["handheld"]
    assert file.stat().st_size < 1_000_000
    for station in (0, 1):
        calibration = file.with_name("handheld.json")
        run = swarm.replay(
            file, lighthouse=station, calibration=calibration, out=tmp_path / "r", record=False, force=True
        )
        figures = run.summary["swarm"]
        assert figures["tracking_share"] > 0.98
        assert figures["residual_median_rad"] < 80e-6
        assert figures["peer_position_scatter_mm"] < 3
        assert figures["integrity"]["failed_residual_test_share"] == 0

"""The compiled filter bank against filterpy's: state by state, and in every column of the telemetry."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import swarm
from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.compiled_interacting import CompiledInteractingBank
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.filter.filterpy_interacting import FilterpyInteractingBank
from estimators.filter.interacting import InteractingBank
from estimators.lanes import LANES
from swarm.hardware import pad
from swarm.onboard.filters import MOST_BY_FILTERPY
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings, QuietModel

ROOT = Path(__file__).parents[1]
T = 1 / 60
COUNT = 30
STATE = ("rotation", "angular_rate", "position", "velocity", "covariance")


def random_covariance(rng: np.random.Generator, count: int) -> Floats:
    """Pose covariances (count, 6, 6) of the size of a craft's at some metres, with any correlations."""
    root = rng.standard_normal((count, 6, 6)) * np.array([1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3])[:, None]
    return np.asarray(root @ np.swapaxes(root, 1, 2) + 1e-10 * np.eye(6))


def assert_same(one: FilterBank, other: FilterBank) -> None:
    np.testing.assert_array_equal(one.active, other.active)
    for name in STATE:
        # Two ways to the same numbers: they part by the rounding of P, whose rates begin a million times its poses.
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-12, err_msg=name)


def test_both_banks_keep_the_same_state_through_starts_gates_gaps_and_stops() -> None:
    rng = np.random.default_rng(5)
    banks: list[FilterBank] = [
        PoseFilterBank(COUNT, gate_probability=0.9),
        CompiledFilterBank(COUNT, gate_probability=0.9),
    ]
    rotation, position = rot.exp(rng.standard_normal((COUNT, 3))), rng.normal([0, 0, 5], 1, (COUNT, 3))
    rate, velocity = 0.5 * rng.standard_normal((COUNT, 3)), 0.2 * rng.standard_normal((COUNT, 3))
    accepted = refused = 0
    for _ in range(80):
        step = T * rng.uniform(0.5, 2.0, COUNT)
        rotation, position = rot.exp(rate * step[:, None]) @ rotation, position + velocity * step[:, None]
        covariance, coupling = random_covariance(rng, COUNT), T / 4 * rng.uniform(-1, 1, (COUNT, 6, 6))
        active = banks[0].active
        lost: Bools = active & (rng.random(COUNT) < 0.02)
        fresh: Bools = ~active & (rng.random(COUNT) < 0.3)
        update: Bools = active & ~lost & (rng.random(COUNT) < 0.8)
        for bank in banks:
            bank.stop(lost)
            bank.predict(step, active & ~lost)
        # A pose solved with assumed rates is off by B times their error (`estimators.lighthouse.dop`).
        assumed = np.concatenate([banks[0].angular_rate, banks[0].velocity], axis=1)
        wrong = np.concatenate([rate, velocity], axis=1) - np.where(update[:, None], assumed, 0.0)
        off = coupling @ wrong[..., None] + np.linalg.cholesky(covariance) @ rng.standard_normal((COUNT, 6, 1))
        seen = rot.exp(off[:, :3, 0]) @ rotation, position + off[:, 3:, 0]
        results = [bank.update_pose(update, *seen, covariance, coupling) for bank in banks]
        for bank in banks:
            bank.start(fresh, *seen, covariance, (1.0, 0.5), coupling)
        np.testing.assert_array_equal(results[0].accepted, results[1].accepted)
        np.testing.assert_allclose(results[0].nis, results[1].nis, rtol=1e-9)
        assert_same(*banks)
        accepted += int(results[0].accepted.sum())
        refused += int((update & ~results[0].accepted).sum())
    assert accepted > 500
    assert refused > 50


def test_a_compiled_covariance_is_symmetric_and_positive_after_a_thousand_periods() -> None:
    rng = np.random.default_rng(6)
    bank, mask = CompiledFilterBank(3), np.ones(3, dtype=np.bool_)
    pose = rot.exp(rng.standard_normal((3, 3))), rng.standard_normal((3, 3))
    covariance, coupling = random_covariance(rng, 3), np.zeros((3, 6, 6))
    bank.start(mask, *pose, covariance, (1.0, 0.5))
    for frame in range(1000):
        bank.predict(T, mask)
        if frame % 7 < 4:
            bank.update_pose(mask, *pose, covariance, coupling)
        p = bank.covariance
        np.testing.assert_array_equal(p, np.swapaxes(p, 1, 2))
    assert np.linalg.eigvalsh(bank.covariance).min() > 0


@pytest.mark.parametrize("kind", [PoseFilterBank, CompiledFilterBank])
def test_motion_that_was_not_ordered_changes_no_bit(kind: type[FilterBank]) -> None:
    """So that navigation may leave it out for a swarm that orders nothing."""
    rng = np.random.default_rng(8)
    bank, mask, none = kind(4), np.ones(4, dtype=np.bool_), np.zeros((4, 3))
    pose = rot.exp(rng.standard_normal((4, 3))), rng.standard_normal((4, 3))
    bank.start(mask, *pose, random_covariance(rng, 4), (1.0, 1.0))
    bank.predict(T, mask)
    before = [getattr(bank, name) for name in STATE]
    bank.add_motion(mask, none, none, none, none)
    for name, value in zip(STATE, before, strict=True):
        np.testing.assert_array_equal(getattr(bank, name), value, err_msg=name)


def test_who_asks_for_a_covariance_between_prediction_and_update_changes_no_bit() -> None:
    rng = np.random.default_rng(8)
    models = np.full(COUNT, 6)
    models[::3] = 2
    noises = [(0.2 / 5**k, 0.2 / 5**k) for k in range(6)]
    asked, left = (CompiledInteractingBank(noises, 30.0, 2.0, models, gate_probability=0.9) for _ in range(2))
    rotation, position = rot.exp(rng.standard_normal((COUNT, 3))), rng.normal([0, 0, 5], 1, (COUNT, 3))
    every = np.ones(COUNT, dtype=np.bool_)
    refused = 0
    for bank in (asked, left):
        bank.start(every, rotation, position, 1e-6 * np.tile(np.eye(6), (COUNT, 1, 1)), (0.1, 0.1))
    for period in range(60):
        covariance, coupling = random_covariance(rng, COUNT), T / 4 * rng.uniform(-1, 1, (COUNT, 6, 6))
        seen: Bools = rng.random(COUNT) < 0.7
        error = np.linalg.cholesky(covariance) @ rng.standard_normal((COUNT, 6, 1))
        pose = rot.exp(error[:, :3, 0]) @ rotation, position + error[:, 3:, 0]
        turn, still, h = 1e-4 * rng.standard_normal((COUNT, 3)), np.zeros((COUNT, 3)), rng.normal(size=(COUNT, 3, 12))
        for bank in (asked, left):
            bank.predict(T, every)
            if bank is asked:
                assert np.isfinite(bank.covariance).all()
                assert np.isfinite(bank.mixtures.covariance).all()
            bank.add_motion(every, still, turn, still, still)
            if bank is asked:
                assert np.isfinite(bank.probability).all()
            if period % 7 < 5:
                refused += int(np.count_nonzero(seen & ~bank.update_pose(seen, *pose, covariance, coupling).accepted))
            else:
                bank.update(seen, error[:, :3, 0], h, np.full((COUNT, 3), 1e-2))
        for one, other in zip(asked.mixtures, left.mixtures, strict=True):
            np.testing.assert_array_equal(one, other)
        for name in STATE:
            np.testing.assert_array_equal(getattr(asked, name), getattr(left, name), err_msg=name)
    assert refused > 20


def test_a_craft_has_the_bits_alone_that_it_has_beside_others() -> None:
    """Also where one of two side by side has just begun, so that its rates become known at once, or sees fewer rows."""
    rng, craft = np.random.default_rng(9), 7
    models = np.array([6, 2, 6, 4, 1, 6, 5])
    noises = [(0.2 / 5**k, 0.2 / 5**k) for k in range(6)]
    together = CompiledInteractingBank(noises, 30.0, 2.0, models, gate_probability=0.9)
    alone = [CompiledInteractingBank(noises, 30.0, 2.0, models[[c]], gate_probability=0.9) for c in range(craft)]
    rotation, position = rot.exp(rng.standard_normal((craft, 3))), rng.normal([0, 0, 5], 1, (craft, 3))
    refused = 0
    for period in range(40):
        covariance, coupling = random_covariance(rng, craft), T / 4 * rng.uniform(-1, 1, (craft, 6, 6))
        fresh: Bools = ~together.active if period == 30 else ~together.active & (rng.random(craft) < 0.1)
        error = np.linalg.cholesky(covariance) @ rng.standard_normal((craft, 6, 1))
        pose = rot.exp(error[:, :3, 0]) @ rotation, position + error[:, 3:, 0]
        seen: Bools = together.active & (rng.random(craft) < 0.8)
        h, count = rng.normal(size=(craft, 4, 12)), rng.integers(1, 5, craft)
        r = np.tile(1e-2 * np.eye(4) + 1e-3, (craft, 1, 1))
        for bank, who in [(together, np.arange(craft)), *((bank, np.array([c])) for c, bank in enumerate(alone))]:
            bank.predict(T, bank.active)
            if period % 7 < 5:
                of = (pose[0][who], pose[1][who], covariance[who], coupling[who])
                refused += int(np.count_nonzero(seen[who] & ~bank.update_pose(seen[who], *of).accepted))
            else:
                bank.update(seen[who], error[who, :4, 0], h[who], r[who], count[who])
            bank.start(fresh[who], pose[0][who], pose[1][who], covariance[who], (10.0, 10.0))
        for c, bank in enumerate(alone):
            for name in STATE:
                np.testing.assert_array_equal(getattr(together, name)[c], getattr(bank, name)[0], err_msg=name)
            np.testing.assert_array_equal(together.probability[c], bank.probability[0])
    assert together.active.all()
    assert refused > 20


def test_an_indefinite_covariance_is_refused_and_named() -> None:
    rng = np.random.default_rng(7)
    bank, mask = CompiledFilterBank(2), np.ones(2, dtype=np.bool_)
    pose = rot.exp(rng.standard_normal((2, 3))), rng.standard_normal((2, 3))
    bank.start(mask, *pose, random_covariance(rng, 2), (0.0, 0.0))
    covariance = np.tile(np.eye(6), (2, 1, 1))
    covariance[1, 3, 4] = covariance[1, 4, 3] = 10.0
    with pytest.raises(ValueError, match="covariance: not positive definite for craft 1"):
        bank.update_pose(mask, *pose, covariance, np.zeros((2, 6, 6)))


@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("formation", ["duration_s=2"]),
        ("static", ["duration_s=1"]),
        ("drift", ["duration_s=2"]),
        ("rendezvous", ["duration_s=6"]),
        # Until the first craft has gone dark, coasted and come back.
        ("crossing", ["duration_s=9"]),
        ("swarm1000", ["duration_s=0.5", "swarm.count=30"]),
        ("survey", ["duration_s=1"]),
        ("cloud", ["duration_s=0.5"]),
        ("ccd-docking", ["duration_s=0.5"]),
    ],
)
def test_every_column_of_the_telemetry_is_filterpys(scenario: str, overrides: list[str], tmp_path: Path) -> None:
    tables: list[pa.Table] = []
    for name in ("filterpy", "compiled"):
        settings = swarm.load(scenario, [*overrides, f"navigation.filter={name}"])
        tables.append(swarm.simulate(settings, out=tmp_path / name, record=False).telemetry)
    assert tables[0].num_rows == tables[1].num_rows > 0
    for field in tables[0].schema:
        one, other = (table.column(field.name) for table in tables)
        if field.type != pa.float64():
            assert one.to_pylist() == other.to_pylist(), field.name
            continue
        # The second pose of a close pair of cameras is a million times surer than the prediction before it: of P only
        # nine digits are left by the shorter form of the update, and the NEES and the cameras' NIS divide by P.
        divided = scenario == "ccd-docking" and field.name in ("nees", "ccd_nis")
        rtol = 1e-8 if divided else 1e-9
        np.testing.assert_allclose(
            one.to_numpy(), other.to_numpy(), rtol=rtol, atol=1e-9, equal_nan=True, err_msg=field.name
        )


@pytest.mark.parametrize(
    ("choice", "craft", "bank"),
    [
        ("auto", MOST_BY_FILTERPY, PoseFilterBank),
        ("auto", MOST_BY_FILTERPY + 1, CompiledFilterBank),
        ("filterpy", MOST_BY_FILTERPY + 1, PoseFilterBank),
        ("compiled", 1, CompiledFilterBank),
    ],
)
def test_the_bank_goes_by_the_setting_and_the_number_of_craft(choice: str, craft: int, bank: type[FilterBank]) -> None:
    layout = pad([np.eye(4, 3)] * craft, [np.eye(4, 3)] * craft)
    settings = NavigationSettings(frame_s=T, angle_noise_rad=4e-5, rotor_correlation=0.87, filter=choice)
    assert type(Navigator(layout, settings).tracks.bank) is bank


def test_models_of_motion_count_as_filters_of_their_own() -> None:
    quiet = QuietModel(5e-5, 5e-5, 30.0, 2.0, models=6)
    for craft, bank in (
        (MOST_BY_FILTERPY // LANES, FilterpyInteractingBank),
        (MOST_BY_FILTERPY // LANES + 1, CompiledInteractingBank),
    ):
        layout = pad([np.eye(4, 3)] * craft, [np.eye(4, 3)] * craft)
        settings = NavigationSettings(frame_s=T, angle_noise_rad=4e-5, rotor_correlation=0.87, quiet=quiet)
        several = Navigator(layout, settings).tracks.bank
        assert type(several) is bank
        expected = 0.2 * (5e-5 / 0.2) ** (np.arange(6) / 5)
        np.testing.assert_allclose(several.grid.acceleration, expected, rtol=1e-12)


def test_a_flight_of_compiled_filters_pays_nothing_for_filterpy() -> None:
    code = "import sys, swarm.flight.simulate; print({'filterpy', 'scipy.stats'} & set(sys.modules))"
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ended.stdout == "set()\n"


@pytest.mark.parametrize("kind", [FilterpyInteractingBank, CompiledInteractingBank])
def test_who_asks_for_the_covariances_of_some_craft_changes_nobody_s_numbers(kind: type[InteractingBank]) -> None:
    """Whichever craft are asked for between a prediction and its update: of all, of some, of one, or of none."""
    rng = np.random.default_rng(11)
    banks = [kind([(0.2, 0.2), (0.01, 0.01), (1e-3, 1e-3)], 30.0, 2.0, np.full(5, 3)) for _ in range(4)]
    every, pose = np.ones(5, dtype=np.bool_), (rot.exp(rng.standard_normal((5, 3))), rng.standard_normal((5, 3)))
    covariance, coupling, some = random_covariance(rng, 5), np.zeros((5, 6, 6)), np.array([0, 1, 0, 1, 1], np.bool_)
    for bank in banks:
        bank.start(every, *pose, covariance, (1.0, 0.5))
    for frame in range(30):
        updated = rng.random(5) < 0.7
        for bank in banks:
            bank.predict(T, every)
        whole = banks[0].covariance
        if frame % 3:
            part = banks[1].covariance_where(some)
            np.testing.assert_array_equal(part[some], whole[some])
            np.testing.assert_array_equal(banks[2].covariance_of(3), whole[3])
            for all_of_it, own, one in zip(bank.state, bank.state_where(some), bank.state_of(3), strict=True):
                np.testing.assert_array_equal(own[some], all_of_it[some])
                np.testing.assert_array_equal(one, all_of_it[3])
        for bank in banks:
            bank.update_pose(updated, *pose, covariance, coupling)
            bank.stop(every & (frame == 20) & some)
            bank.start(~bank.active, *pose, covariance, (1.0, 0.5))
    for bank in banks[1:]:
        for name in STATE:
            np.testing.assert_array_equal(getattr(bank, name), getattr(banks[0], name), err_msg=name)


@pytest.mark.parametrize("kind", [FilterpyInteractingBank, CompiledInteractingBank])
def test_covariances_for_reading_stay_as_they_were_and_tell_what_a_copy_tells(kind: type[InteractingBank]) -> None:
    rng, craft, models = np.random.default_rng(11), 5, np.full(5, 6)
    noises = [(0.2 / 4**k, 0.2 / 4**k) for k in range(6)]
    read, copied = (kind(noises, 30.0, 2.0, models) for _ in range(2))
    rotation, position = rot.exp(0.2 * rng.standard_normal((craft, 3))), rng.normal([0, 0, 5], 1, (craft, 3))
    covariance, coupling = random_covariance(rng, craft), np.zeros((craft, 6, 6))
    some = np.arange(craft) < 3
    kept = []
    for bank in (read, copied):
        bank.start(np.arange(craft) < 4, rotation, position, covariance, (1.0, 0.5))
    for period in range(12):
        seen = some if period % 3 else some & (np.arange(craft) > 0)
        for bank in (read, copied):
            bank.predict(T, bank.active)
            bank.update_pose(seen & bank.active, rotation, position, covariance, coupling)
        now = read.covariance_to_read()
        np.testing.assert_array_equal(now, copied.covariance)
        kept.append((now, now.copy()))
        if period == 5:
            for bank in (read, copied):
                bank.adopt(some & (np.arange(craft) > 1), bank.state, 4 * bank.covariance)
        if period == 8:
            for bank in (read, copied):
                bank.stop(np.arange(craft) == 1)
    for now, then in kept:
        np.testing.assert_array_equal(now, then)
    assert np.isnan(read.covariance[4]).all()
    assert np.isnan(read.covariance[1]).all()

"""The pulse decoder against pulses written down by a generator that shares no code with it."""

import math
import random
from typing import Any

import numpy as np
import pytest

from swarm.messages import Pulses
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.onboard.flashes import MAX_FLASHES

TICK_S = 20e-9
TURN = 1 / 60 / TICK_S
HALF_TICK_RAD = 0.5 * TICK_S * 2 * math.pi * 60
X, Y, DATA, SKIP = 0, 1, 2, 4
Pulse = tuple[int, int, int]

THETA = [(1.2, 1.9), (1.5, 1.6), (2.2, 0.9), (0.7, 2.3), (1.6, 1.5)]
"""Angles (X, Y) of five photodiodes [rad]."""


def flash(tick: float, code: int, photodiodes: int = 5, tick_s: float = TICK_S) -> list[Pulse]:
    width = round((3000 + 500 * code) / 48e6 / tick_s)
    return [(k, round(tick), width) for k in range(photodiodes)]


def sweep(flash_tick: float, angles: list[float], width: int = 300, turn: float = TURN) -> list[Pulse]:
    """Pulses whose middles are at the angles after the flash, to half a tick."""
    return [(k, round(flash_tick + a / (2 * math.pi) * turn - width / 2), width) for k, a in enumerate(angles)]


def period(start: float, theta: list[tuple[float, float]] = THETA, missing: str = "") -> list[Pulse]:
    """One period of one station: flash X, sweep X, flash Y, sweep Y. missing: flashes left out, of "XY"."""
    pulses = sweep(start, [t[0] for t in theta]) + sweep(start + TURN / 2, [t[1] for t in theta])
    if "X" not in missing:
        pulses += flash(start, X)
    if "Y" not in missing:
        pulses += flash(start + TURN / 2, Y)
    return pulses


def batch(*craft: list[Pulse]) -> Pulses:
    most = max((len(pulses) for pulses in craft), default=0)
    out = Pulses(
        np.full((len(craft), most), -7, dtype=np.int16),
        np.full((len(craft), most), 99, dtype=np.int64),
        np.full((len(craft), most), 1, dtype=np.int32),
        np.array([len(pulses) for pulses in craft], dtype=np.int32),
    )
    for c, pulses in enumerate(craft):
        for i, (k, rise, width) in enumerate(sorted(pulses, key=lambda pulse: pulse[1])):
            out.photodiode[c, i], out.rise_tick[c, i], out.width_tick[c, i] = k, rise, width
    return out


def decoder(craft: int = 1, **options: float) -> PulseDecoder:
    return PulseDecoder(np.ones((craft, 5), dtype=bool), TICK_S, **options)  # type: ignore[arg-type]


def assert_reads_theta(angles: SweepAngles, ticks: float = 2.0) -> None:
    # Half a tick of the sweep pulse's rise and of each flash's: at most 1.5 when the flash is predicted from another.
    np.testing.assert_allclose(angles.theta[0], THETA, rtol=0, atol=ticks * HALF_TICK_RAD)
    assert angles.lit.all()


def test_angles_and_their_instants_are_exact_to_the_ticks() -> None:
    start = 123_456_789
    angles = decoder().decode(batch(period(start)))
    assert_reads_theta(angles)
    np.testing.assert_allclose(angles.theta[0, :, 0], [t[0] for t in THETA], rtol=0, atol=1.001 * HALF_TICK_RAD)
    assert abs(angles.epoch_tick[0] - (start + TURN / 2)) <= 0.5
    for fan, flash_s in ((0, -1 / 120), (1, 0.0)):
        instants = [flash_s + t[fan] / (2 * math.pi * 60) for t in THETA]
        np.testing.assert_allclose(angles.offset_s[0, :, fan], instants, rtol=0, atol=2 * TICK_S)
    assert angles.missed_sync[0] == 0
    assert angles.rejected[0] == 0


def test_a_pulse_between_two_ticks_counts_half() -> None:
    pulses = flash(1000, X) + flash(1000 + TURN / 2, Y) + [(3, 301_000, 301)]
    angles = decoder().decode(batch(pulses))
    assert angles.theta[0, 3, 0] == pytest.approx((300_000 + 150.5) * TICK_S * 120 * math.pi, abs=1e-12)
    assert np.isnan(angles.theta[0, 3, 1])
    assert not angles.lit.any()


def test_before_any_flash_nothing_is_known() -> None:
    for pulses in ([], period(5000, missing="XY"), period(5000, missing="X"), period(5000, missing="Y")):
        angles = decoder().decode(batch(pulses))
        assert angles.epoch_tick[0] == -1
        assert not angles.lit.any()
        assert np.isnan(angles.theta).all()
        assert angles.missed_sync[0] == 0
        assert (angles.offset_s == 0).all()


@pytest.mark.parametrize(("missing", "count"), [("X", 1), ("Y", 1), ("XY", 2)])
def test_a_missed_flash_is_predicted(missing: str, count: int) -> None:
    computer = decoder()
    computer.decode(batch(period(7000)))
    for n in range(1, 4):
        angles = computer.decode(batch(period(7000 + n * TURN, missing=missing)))
        assert_reads_theta(angles, ticks=3.0)
        assert angles.missed_sync[0] == count
        assert angles.rejected[0] == 0
        assert abs(angles.epoch_tick[0] - (7000 + (n + 0.5) * TURN)) <= 1


def test_prediction_ends_and_the_craft_locks_on_again() -> None:
    computer = decoder(coast_turns=3)
    computer.decode(batch(period(7000)))
    lit = [computer.decode(batch(period(7000 + n * TURN, missing="XY"))).lit.all() for n in range(1, 6)]
    assert lit == [True, True, True, False, False]
    late = computer.decode(batch(period(7000 + 6 * TURN, missing="XY")))
    assert abs(late.epoch_tick[0] - (7000 + 6.5 * TURN)) <= 1  # Time goes on without angles.
    assert late.missed_sync[0] == 2
    assert late.rejected[0] == 10
    # The rotor was restarted meanwhile: only a pair of flashes half a turn apart is believed.
    moved = 7000 + 7.3 * TURN
    assert not decoder_lit(computer, period(moved, missing="Y"))
    assert decoder_lit(computer, period(moved + TURN))


def decoder_lit(computer: PulseDecoder, pulses: list[Pulse]) -> bool:
    return bool(computer.decode(batch(pulses)).lit.all())


def test_one_fan_lost_for_long_is_timed_by_the_other() -> None:
    computer = decoder(coast_turns=2)
    computer.decode(batch(period(0)))
    for n in range(1, 8):
        angles = computer.decode(batch(period(n * TURN, missing="X")))
        assert_reads_theta(angles, ticks=3.0)
        assert angles.missed_sync[0] == 1


def test_a_flash_where_none_should_be_is_rejected() -> None:
    computer = decoder()
    computer.decode(batch(period(9000)))
    stray = flash(9000 + 1.02 * TURN, X, photodiodes=2)
    angles = computer.decode(batch(period(9000 + TURN) + stray))
    assert_reads_theta(angles)
    assert angles.rejected[0] == 2
    # And with the true one missing, it does not take its place.
    angles = computer.decode(batch(period(9000 + 2 * TURN, missing="X") + flash(9000 + 2.02 * TURN, X, 2)))
    assert_reads_theta(angles, ticks=3.0)
    assert angles.missed_sync[0] == 1


def test_a_flash_rises_with_its_first_photodiode_and_is_as_long_as_its_longest() -> None:
    computer = decoder()
    computer.decode(batch(period(1000 - TURN)))
    # In weak light a photodiode triggers late, or lets go early: each alone would say code 0 or none at all.
    longest = round(5000 / 48e6 / TICK_S)  # Code 4: fan X, and no sweep follows.
    ragged = [(1, 1000, longest - 2083), (2, 1030, longest - 30), (0, 1040, longest), (3, 3900, 2300)]
    angles = computer.decode(batch([p for p in period(1000) if p[1] != 1000] + ragged))
    assert angles.epoch_tick[0] == round(1000 + TURN / 2)
    assert angles.missed_sync[0] == 0
    assert np.isnan(angles.theta[0, :, 0]).all()
    np.testing.assert_allclose(angles.theta[0, :, 1], [t[1] for t in THETA], rtol=0, atol=2 * HALF_TICK_RAD)
    assert angles.rejected[0] == 5  # Sweep pulses that no sweep was announced for.


def test_a_flash_too_short_for_any_code_is_none() -> None:
    computer = decoder()
    computer.decode(batch(period(0)))
    short = round(2000 / 48e6 / TICK_S)
    angles = computer.decode(batch([*period(TURN, missing="Y"), (0, round(1.5 * TURN), short)]))
    assert angles.missed_sync[0] == 1
    assert angles.rejected[0] == 1


def test_flashes_that_announce_no_sweep_are_not_locked_on() -> None:
    sweeps = [p for p in period(0) if p[2] < 1000]
    angles = decoder().decode(batch(sweeps + flash(0, X | SKIP) + flash(TURN / 2, Y | SKIP)))
    assert angles.epoch_tick[0] == -1


@pytest.mark.parametrize("code", range(8))
def test_every_code_is_read_from_the_width(code: int) -> None:
    computer = decoder()
    computer.decode(batch(period(0)))
    fan, other = code & 1, 1 - (code & 1)
    pulses = [p for p in period(TURN, missing="XY") if p[2] < 1000]
    at = TURN + fan * TURN / 2
    # 0.45 of a step either way is still the same code.
    for slip in (-0.45, 0.45):
        width = round((3000 + 500 * (code + slip)) / 48e6 / TICK_S)
        again = decoder()
        again.decode(batch(period(0)))
        angles = again.decode(batch([*pulses, (0, round(at), width)]))
        assert angles.missed_sync[0] == 1  # The other fan's only.
        assert np.isfinite(angles.theta[0, :, fan]).all() == (code & SKIP == 0)
        assert np.isfinite(angles.theta[0, :, other]).all()


def test_doubled_pulses_are_both_rejected() -> None:
    pulses = period(0)
    ghost = next(p for p in pulses if p[0] == 2 and p[2] == 300)
    angles = decoder().decode(batch([*pulses, (2, ghost[1] + 4000, 250)]))
    assert np.isnan(angles.theta[0, 2, 0])
    assert angles.offset_s[0, 2, 0] == 0
    assert angles.lit[0].tolist() == [True, True, False, True, True]
    assert angles.rejected[0] == 2
    angles = decoder().decode(batch([*pulses, (2, ghost[1] + 4000, 250), (2, ghost[1] + 9000, 250)]))
    assert angles.rejected[0] == 3
    assert angles.lit[0].sum() == 4


def test_pulses_that_belong_to_nothing_are_counted() -> None:
    late = (1, round(0.47 * TURN), 200)  # 169 degrees after flash X: outside the field.
    early = (1, round(0.02 * TURN), 200)
    before = (1, -4000, 200)
    strange = [(5, round(0.25 * TURN), 200), (-1, round(0.25 * TURN), 200), (300, round(0.7 * TURN), 200)]
    long = (0, round(0.3 * TURN), 60_000)
    negative = (0, round(0.3 * TURN), -5)
    angles = decoder().decode(batch([*period(0), late, early, before, *strange, long, negative]))
    assert_reads_theta(angles)
    assert angles.rejected[0] == 8


def test_a_padded_photodiode_is_not_one_of_the_craft() -> None:
    present = np.array([[True, True, True, False, True]])
    angles = PulseDecoder(present, TICK_S).decode(batch(period(0)))
    assert angles.lit[0].tolist() == present[0].tolist()
    assert angles.rejected[0] == 4  # Its two flashes and two sweeps.


def two_stations(start: float, turn: float, tick_s: float) -> list[Pulse]:
    """Both stations' period of two turns, the first's X flash at `start`; the second sweeps 0.1 rad later."""
    gap = 20000 / 48e6 / tick_s
    pulses: list[Pulse] = []
    for half in range(4):
        at, fan, turn_of_first = start + half * turn / 2, half % 2, half < 2
        pulses += flash(at, fan | DATA | (0 if turn_of_first else SKIP), tick_s=tick_s)
        pulses += flash(at + gap, fan | (SKIP if turn_of_first else 0), tick_s=tick_s)
        begin, shift = (at, 0.0) if turn_of_first else (at + gap, 0.1)
        pulses += sweep(begin, [t[fan] + shift for t in THETA], turn=turn)
    return pulses


@pytest.mark.parametrize("slot", [0, 1])
def test_of_two_stations_one_is_followed(slot: int) -> None:
    tick_s = 1 / 48e6
    turn = 800_000
    stream = [p for n in range(5) for p in two_stations(50_000 + n * 2 * turn, turn, tick_s)]
    first = 50_000 + slot * (turn + 20_000)
    if slot == 0:  # One of its flashes is lost, and the other station's next to another.
        stream = [p for p in stream if p[1] not in (first + 2 * turn, first + 4 * turn + 20_000)]
    computer = PulseDecoder(np.ones((1, 5), dtype=bool), tick_s, frame_s=1 / 30, slot=slot)
    for n in range(4):
        begin = first + n * 2 * turn - 28_800
        angles = computer.decode(batch([p for p in stream if begin <= p[1] < begin + 2 * turn]))
        wanted = np.array(THETA) + 0.1 * slot
        np.testing.assert_allclose(angles.theta[0], wanted, rtol=0, atol=0.5 * 2 * math.pi / turn + 1e-12)
        assert angles.epoch_tick[0] == first + n * 2 * turn + turn // 2
        assert angles.rejected[0] == 0
        assert angles.missed_sync[0] == (1 if slot == 0 and n == 1 else 0)


def random_stream(seed: int, periods: int) -> list[list[Pulse]]:
    """One craft's periods: everything that can go wrong, now and then, on a clock of its own."""
    rng = random.Random(seed)
    begin = rng.randrange(-(10**9), 10**12)
    out = []
    for n in range(periods):
        theta = [(rng.uniform(0.6, 2.5), rng.uniform(0.6, 2.5)) for _ in range(5)]
        pulses = period(begin + n * TURN, theta, missing=rng.choice(["", "", "X", "Y", "XY"]))
        pulses = [p for p in pulses if rng.random() > 0.1]
        pulses += [
            (rng.randrange(5), round(begin + (n + rng.random()) * TURN), rng.randrange(1, 8000)) for _ in range(3)
        ]
        out.append(pulses)
    return out


def test_a_craft_reads_the_same_alone_and_in_a_swarm() -> None:
    craft = [random_stream(seed, 40) for seed in range(12)]
    swarm = decoder(len(craft))
    alone = [decoder() for _ in craft]
    for n in range(40):
        together = swarm.decode(batch(*(stream[n] for stream in craft)))
        for c, stream in enumerate(craft):
            single = alone[c].decode(batch(stream[n]))
            for mine, shared in zip(single, together, strict=True):
                np.testing.assert_array_equal(mine[0], shared[c])


def test_the_clock_of_a_craft_may_show_any_time() -> None:
    for begin in (0, -(10**10), 10**13):
        assert_reads_theta(decoder().decode(batch(period(begin))))


def test_no_pulses_whatever_raise_or_light_half_a_photodiode() -> None:
    rng = np.random.default_rng(5)
    computer = PulseDecoder(rng.random((30, 7)) < 0.8, TICK_S)
    pair = PulseDecoder(np.ones((30, 7), dtype=bool), TICK_S, frame_s=1 / 30, slot=1)
    for n in range(60):
        count = 120
        scale = [1e3, 1e6, 1e9, 9e18][n % 4]
        rise = (rng.uniform(-1, 1, (30, count)) * scale).astype(np.int64)
        if n % 3:
            rise = np.sort(rise, axis=1)
        soup = Pulses(
            rng.integers(-3, 9, (30, count)).astype(np.int16),
            rise,
            (rng.integers(-(2**31), 2**31, (30, count)) // 2 ** rng.integers(0, 24, (30, count))).astype(np.int32),
            rng.integers(-5, count + 50, 30).astype(np.int32),
        )
        for reader in (computer, pair):
            angles = reader.decode(soup)
            seen = np.isfinite(angles.theta)
            np.testing.assert_array_equal(angles.lit, seen.all(axis=2))
            assert (angles.offset_s[~seen] == 0).all()
            assert np.all((angles.theta[seen] > 0) & (angles.theta[seen] < np.pi))
            assert np.all((angles.missed_sync >= 0) & (angles.missed_sync <= 2))
            assert np.all((angles.rejected >= 0) & (angles.rejected <= count))


@pytest.mark.parametrize(
    "options",
    [
        {"frame_s": 0.02},
        {"frame_s": 1 / 15},
        {"slot": 1},
        {"slot": -1},
        {"field_half_angle_rad": 1.6},
        {"rate_hz": -60.0},
    ],
)
def test_impossible_settings_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must"):
        decoder(**options)


def test_pulses_of_another_number_of_craft_are_refused() -> None:
    with pytest.raises(ValueError, match="2 craft"):
        decoder().decode(batch([], []))


def test_of_two_pulses_in_one_sweep_the_expected_one_is_taken_if_it_stands_out() -> None:
    start, where = 50_000, np.array(THETA)[None]
    second = {0: 30e-3, 1: -4e-3, 2: 1e-3, 3: 30e-3}

    def read(off: dict[int, float], expected: np.ndarray | None) -> tuple[SweepAngles, list[bool]]:
        pulses = period(start)
        for k, away in off.items():
            pulses.append((k, *sweep(start, [THETA[k][0] + away])[0][1:]))
        asked: list[int] = []

        def expect(craft: np.ndarray) -> np.ndarray:
            asked.extend(craft)
            assert expected is not None
            return expected[craft]

        angles = decoder().decode(batch(pulses), None if expected is None else expect)
        assert asked == ([] if expected is None or not off else [0]), "only where several pulses compete"
        return angles, np.isfinite(angles.theta[0, :, 0]).tolist()

    angles, known = read(second, None)
    assert known == [False, False, False, False, True], "nothing is expected anywhere: both are dropped"
    assert angles.rejected[0] == 8
    # Photodiode 0 stands out, 1 just so; 2 does not: its two pulses are as near as each other; 3 is not expected.
    expected = where + np.array([[[0.5e-3, 0], [1.2e-3, 0], [0.5e-3, 0], [np.nan, 0], [0.2, 0]]])
    angles, known = read(second, expected)
    assert known == [True, True, False, False, True]
    np.testing.assert_allclose(angles.theta[0, [0, 1, 4], 0], where[0, [0, 1, 4], 0], rtol=0, atol=2 * HALF_TICK_RAD)
    assert angles.rejected[0] == 6
    # One pulse alone is taken wherever it is; of two far from where they should be, none.
    assert read({4: 30e-3}, expected)[1] == [True, True, True, True, False]
    assert read({}, expected)[1] == [True] * 5
    with pytest.raises(ValueError, match="expected must be"):
        read(second, where[:, :3])


def test_flashes_beyond_the_room_for_them_are_rejected() -> None:
    computer = decoder()
    computer.decode(batch(period(9000)))
    start = 9000 + TURN
    stray = [pulse for i in range(MAX_FLASHES + 3) for pulse in flash(start + TURN * (0.02 + 0.008 * i), DATA, 2)]
    angles = computer.decode(batch(period(start) + stray))
    # Of the room, the X flash has one place: the Y flash of five pulses comes behind the last.
    assert angles.rejected[0] == len(stray) + 5
    assert angles.missed_sync[0] == 1
    assert_reads_theta(angles, ticks=3.0)

"""Numbers without a state: Philox as published, its normal numbers by moments, tails and correlations, their names."""

from statistics import NormalDist

import numpy as np
import pytest
from scipy.stats import chi2, norm

from estimators.lanes import WIDE
from swarm.draws import (
    key_of,
    keys_of,
    normal_quantile,
    normal_quantiles_into,
    normal_rows,
    normals,
    philox,
    uniform_rows,
    uniforms,
)
from swarm.random import Purpose

KEYS = keys_of(3, Purpose.LIGHT, range(400))


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ((0, 0, 0, 0), 0, (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((0xFFFFFFFF,) * 4, 0xFFFFFFFFFFFFFFFF, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            0x299F31D0A4093822,
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_gives_the_published_words(counter, key, expected) -> None:
    """The vectors of Philox4x32-10 in Random123's file of known answers."""
    words = philox(np.uint64(key), *(np.uint64(word) for word in counter))
    assert tuple(int(word) for word in words) == expected


def test_two_numbers_are_all_bits_of_a_name() -> None:
    words = philox(KEYS[0], np.uint64(7), np.uint64(1), np.uint64(5), np.uint64(2))
    pairs = (int(words[1]) << 32 | int(words[0]), int(words[3]) << 32 | int(words[2]))
    expected = [((bits >> 12) + 0.5) / 2**52 for bits in pairs]
    assert list(uniforms(KEYS[0], (1 << 32) + 7, 5, 2)) == expected
    assert list(normals(KEYS[0], (1 << 32) + 7, 5, 2)) == [normal_quantile(share) for share in expected]


@pytest.mark.parametrize("share", [2.0**-53, 1e-12, 1e-5, 0.07, 0.0750001, 0.3, 0.5, 0.7, 0.9249999, 0.93, 1 - 1e-9])
def test_quantiles_are_those_of_pythons_own(share: float) -> None:
    # Python's rounds every product of its polynomials, ours one with each sum.
    assert normal_quantile(share) == pytest.approx(NormalDist().inv_cdf(share), rel=5e-16, abs=1e-300)
    # Against another algorithm: SciPy's inverse.
    assert normal_quantile(share) == pytest.approx(norm.ppf(share), rel=1e-12, abs=1e-300)


def test_the_largest_and_smallest_numbers_are_finite_and_opposite() -> None:
    assert normal_quantile(2.0**-53) == -normal_quantile(1 - 2.0**-53)
    assert normal_quantile(1 - 2.0**-53) == pytest.approx(8.2095, abs=1e-3)


def test_normal_numbers_have_the_moments_and_the_tails() -> None:
    drawn = np.concatenate([normal_rows(KEYS, frame, 100) for frame in range(30)])
    n = drawn.size  # 1.2 million
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)):
        assert abs((drawn**power).mean() - moment) < 4.5 * np.sqrt(variance / n), power
    for beyond in (2.0, 3.0, 4.0, 4.5):
        for side in (drawn, -drawn):
            expected = n * norm.sf(beyond)
            assert abs((side > beyond).sum() - expected) < 4.5 * np.sqrt(expected) + 1, beyond
    count, _ = np.histogram(norm.cdf(drawn), bins=1000, range=(0, 1))
    assert chi2.ppf(1e-4, 999) < np.sum((count - n / 1000) ** 2 / (n / 1000)) < chi2.ppf(1 - 1e-4, 999)


def test_craft_periods_photodiodes_and_pairs_are_independent() -> None:
    drawn = np.stack([normal_rows(KEYS, frame, 24) for frame in range(200)])  # (frame, craft, number)
    limit = 5 / np.sqrt(drawn.size)
    neighbours = {
        "period": (drawn[1:], drawn[:-1]),
        "craft": (drawn[:, 1:], drawn[:, :-1]),
        "fan": (drawn[..., ::2], drawn[..., 1::2]),
        "photodiode": (drawn[..., 2:], drawn[..., :-2]),
    }
    for name, (one, other) in neighbours.items():
        assert abs(np.mean(one * other)) < limit * 1.5, name
        assert abs(np.mean((one**2 - 1) * (other**2 - 1)) / 2) < limit * 1.5, name
    among = np.corrcoef(drawn.transpose(1, 0, 2).reshape(len(KEYS), -1))
    assert np.abs(among - np.eye(len(KEYS))).max() < 6 / np.sqrt(200 * 24)


def test_a_name_alone_decides() -> None:
    some = normal_rows(KEYS[[3, 17]], 5, 7)
    assert np.array_equal(some, normal_rows(KEYS, 5, 20)[[3, 17], :7])
    assert np.array_equal(normal_rows(KEYS[3:4], 5, 4)[0], [*normals(KEYS[3], 5, 0, 0), *normals(KEYS[3], 5, 1, 0)])
    shares = uniform_rows(KEYS, 5, 3)
    assert 0 < shares.min() < shares.max() < 1
    assert len({*(key_of(seed, Purpose.LIGHT, 999) for seed in range(50)), *KEYS}) == 450
    different = {uniforms(KEYS[0], *name)[0] for name in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1 << 32, 0, 0))}
    assert len(different) == 5


def test_purposes_and_names_have_keys_of_their_own() -> None:
    keys = {key_of(1, purpose, 5, 2) for purpose in Purpose} | {key_of(1, purpose) for purpose in Purpose}
    assert len(keys) == 2 * len(Purpose)


def test_quantiles_side_by_side_are_those_one_by_one() -> None:
    """Shares of all parts and of their borders, as far out as draws go."""
    rng = np.random.default_rng(5)
    ends = np.concatenate([[2.0**-53, 1e-15, 1.9e-11, 2.1e-11, np.exp(-25.0), 0.075], 10 ** rng.uniform(-15, -1, 50)])
    share = rng.permutation(np.concatenate([ends, 1 - ends, rng.random(200)]))
    share = share[: len(share) // WIDE * WIDE].reshape(-1, WIDE)
    out, groups = np.zeros_like(share), len(share) - 2
    normal_quantiles_into(groups, share, out, np.ones_like(share), np.empty(share.size, np.int64))
    expected = np.reshape([normal_quantile(float(one)) for one in share.flat], share.shape)
    np.testing.assert_array_equal(out[:groups], expected[:groups])
    assert np.all(out[groups:] == 0)

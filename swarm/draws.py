"""Random numbers without a state: each is a function of its name, whatever was drawn before, by whomever.

A name is a key of 64 bits, from the run's seed, a purpose and the names of what draws (`swarm.random`), and three whole
numbers, such as the period, the photodiode and the kind of draw. The generator is Philox4x32-10 (Salmon, Moraes, Dror,
Shaw, SC 2011): ten rounds of two products of 32 bits make four words of 32 bits of key and counter, which are two
numbers of 52 bits between 0 and 1. Normal numbers are their quantiles by Wichura's AS 241 (1988), exact to 1e-16 of
their value and as far out as the 52 bits go, 8.2 standard deviations.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import WIDE, wide_in
from swarm.random import Purpose

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_MIDDLE = 0.425
"""Distance of a share from 1/2 up to which the middle polynomials serve."""
_END = 2e-11
"""Shares up to e^-25, and some more."""
_WORD, _32, _12 = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(12)

Keys = NDArray[np.uint64]


def key_of(seed: int, purpose: Purpose, *names: int) -> np.uint64:
    """Return the key of the numbers that something draws in a run.

    Args:
        seed: the run's seed.
        purpose: what the numbers are for.
        names: numbers that name who draws, such as a station's and a craft's, each at least 0.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(*purpose.value, *names))
    return np.uint64(sequence.generate_state(1, np.uint64)[0])


def keys_of(seed: int, purpose: Purpose, names: Iterable[int]) -> Keys:
    """Return the keys of several that draw for the same purpose in a run, (N,).

    Args:
        seed: the run's seed.
        purpose: what the numbers are for.
        names: number that names each, at least 0.
    """
    return np.array([key_of(seed, purpose, name) for name in names], dtype=np.uint64)


@kernel
def philox(
    key: np.uint64, a: np.uint64, b: np.uint64, c: np.uint64, d: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return four words of 32 bits by Philox4x32-10.

    Args:
        key: key; its lower half is the generator's first word.
        a: first word of the counter, of 32 bits, as are the others.
        b: second word.
        c: third word.
        d: fourth word.
    """
    low, high = key & _WORD, key >> _32
    for _ in range(10):
        p, q = _M0 * a, _M1 * c
        a, b, c, d = (q >> _32) ^ b ^ low, q & _WORD, (p >> _32) ^ d ^ high, p & _WORD
        low, high = (low + _W0) & _WORD, (high + _W1) & _WORD
    return a, b, c, d


@kernel
def _share(low: np.uint64, high: np.uint64) -> float:
    """Return the middle of one of 2^52 equal parts between 0 and 1."""
    return (float(((high << _32) | low) >> _12) + 0.5) / 4503599627370496.0


@kernel
def uniforms(key: np.uint64, first: int, second: int, kind: int) -> tuple[float, float]:
    """Return two numbers between 0 and 1, both excluded, by their name.

    Args:
        key: key of who draws.
        first: a whole number, such as that of a period or sweep.
        second: another one of 32 bits, such as that of a photodiode.
        kind: another one of 32 bits, such as that of the kind of draw.
    """
    long = np.uint64(first)
    words = philox(key, long & _WORD, long >> _32, np.uint64(second) & _WORD, np.uint64(kind) & _WORD)
    return _share(words[0], words[1]), _share(words[2], words[3])


@kernel
def uniforms_into(key: np.uint64, first: int, kind: int, count: int, out: Floats) -> None:
    """Write the numbers that `uniforms` returns for the second whole numbers 0 to `count` - 1, side by side.

    Args:
        key: key of who draws.
        first: a whole number, such as that of a period or sweep.
        kind: another one of 32 bits, such as that of the kind of draw.
        count: how many pairs.
        out: output, pair by pair, (2 count,) or longer.
    """
    for second in range(count):
        out[2 * second], out[2 * second + 1] = uniforms(key, first, second, kind)


@kernel
def normal_quantile(share: float) -> float:
    """Return the standard normal number below which a share of all numbers lies; 0 < share < 1 (AS 241)."""
    if abs(share - 0.5) <= _MIDDLE:
        return _middle(share)
    r = np.sqrt(-np.log(min(share, 1 - share)))
    out: float = _tail(r) if r <= 5 else _far_tail(r)
    return -out if share < 0.5 else out


@kernel
def normal_quantiles_into(count: int, share: Floats, out: Floats, far: Floats, which: Ints) -> None:
    """Write the quantiles of many shares, side by side: first all as if none were far out, then those that are.

    Args:
        count: number of groups of shares.
        share: shares, (G, WIDE).
        out: output, (G, WIDE).
        far: room for as many numbers, (G, WIDE), positive ones.
        which: room for as many whole numbers, (G WIDE,).
    """
    shares, quantiles, tails, number = wide_in(share), wide_in(out), wide_in(far), 0
    for g in range(count):
        quantiles[g] = _middle(shares[g])
        for i in range(WIDE):
            which[number] = WIDE * g + i
            number += not abs(share[g, i] - 0.5) <= _MIDDLE
    for n in range(number):
        one = share[which[n] // WIDE, which[n] % WIDE]
        far[n // WIDE, n % WIDE] = -np.log(min(one, 1 - one))
    for g in range(-(-number // WIDE)):
        tails[g] = _tail(np.sqrt(tails[g]))
    for n in range(number):
        g, i = which[n] // WIDE, which[n] % WIDE
        tail, end = far[n // WIDE, n % WIDE], min(share[g, i], 1 - share[g, i])
        out[g, i] = normal_quantile(share[g, i]) if end < _END else -tail if share[g, i] < 0.5 else tail


@kernel
def _middle(share: float) -> float:
    """Return the quantile of a share between 0.075 and 0.925, numbers or lanes."""
    q = share - 0.5
    r = 0.180625 - q * q
    above = 2.5090809287301226727e3 * r + 3.3430575583588128105e4
    above = (above * r + 6.7265770927008700853e4) * r + 4.5921953931549871457e4
    above = (above * r + 1.3731693765509461125e4) * r + 1.9715909503065514427e3
    above = (above * r + 1.3314166789178437745e2) * r + 3.387132872796366608
    below = 5.226495278852854561e3 * r + 2.8729085735721942674e4
    below = (below * r + 3.9307895800092710610e4) * r + 2.1213794301586595867e4
    below = (below * r + 5.3941960214247511077e3) * r + 6.8718700749205790830e2
    below = (below * r + 4.2313330701600911252e1) * r + 1.0
    return q * above / below


@kernel
def _tail(r: float) -> float:
    """Return the magnitude of the same of a share with ends of e^(-r^2), 0.075 or less and r up to 5."""
    r = r - 1.6
    above = 7.74545014278341407640e-4 * r + 2.27238449892691845833e-2
    above = (above * r + 2.41780725177450611770e-1) * r + 1.27045825245236838258
    above = (above * r + 3.64784832476320460504) * r + 5.76949722146069140550
    above = (above * r + 4.63033784615654529590) * r + 1.42343711074968357734
    below = 1.05075007164441684324e-9 * r + 5.47593808499534494600e-4
    below = (below * r + 1.51986665636164571966e-2) * r + 1.48103976427480074590e-1
    below = (below * r + 6.89767334985100004550e-1) * r + 1.67638483018380384940
    below = (below * r + 2.05319162663775882187) * r + 1.0
    return above / below


@kernel
def _far_tail(r: float) -> float:
    """Return the same of an r beyond 5."""
    r = r - 5
    above = 2.01033439929228813265e-7 * r + 2.71155556874348757815e-5
    above = (above * r + 1.24266094738807843860e-3) * r + 2.65321895265761230930e-2
    above = (above * r + 2.96560571828504891230e-1) * r + 1.78482653991729133580
    above = (above * r + 5.46378491116411436990) * r + 6.65790464350110377720
    below = 2.04426310338993978564e-15 * r + 1.42151175831644588870e-7
    below = (below * r + 1.84631831751005468180e-5) * r + 7.86869131145613259100e-4
    below = (below * r + 1.48753612908506148525e-2) * r + 1.36929880922735805310e-1
    below = (below * r + 5.99832206555887937690e-1) * r + 1.0
    return above / below


@kernel
def normals(key: np.uint64, first: int, second: int, kind: int) -> tuple[float, float]:
    """Return two standard normal numbers by their name.

    Args:
        key: key of who draws.
        first: a whole number, such as that of a period or sweep.
        second: another one of 32 bits, such as that of a photodiode.
        kind: another one of 32 bits, such as that of the kind of draw.
    """
    pair = uniforms(key, first, second, kind)
    return normal_quantile(pair[0]), normal_quantile(pair[1])


def uniform_rows(keys: Keys, frame: int, count: int) -> Floats:
    """Return numbers between 0 and 1 of N that draw, (N, count).

    Args:
        keys: keys of who draws, (N,).
        frame: number of the period.
        count: numbers of each; more do not change the first ones.
    """
    out = np.empty((len(keys), count))
    _rows_into(keys, frame, False, out)
    return out


def normal_rows(keys: Keys, frame: int, count: int) -> Floats:
    """Return standard normal numbers of N that draw, (N, count).

    Args:
        keys: keys of who draws, (N,).
        frame: number of the period.
        count: numbers of each; more do not change the first ones.
    """
    out = np.empty((len(keys), count))
    _rows_into(keys, frame, True, out)
    return out


@kernel
def _rows_into(keys: Keys, frame: int, normal: bool, out: Floats) -> None:
    for i in range(len(keys)):
        for pair in range((out.shape[1] + 1) // 2):
            drawn = uniforms(keys[i], frame, pair, 0)
            for j in range(2):
                if 2 * pair + j < out.shape[1]:
                    out[i, 2 * pair + j] = normal_quantile(drawn[j]) if normal else drawn[j]

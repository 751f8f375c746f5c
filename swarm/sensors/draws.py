"""Random numbers without a state: each is a function of its name, whatever was drawn before, and costs nothing else.

A station's light needs one number per photodiode and sweep, of which few are lit: a stream per craft and station would
draw far more than are used. A name is a key of 64 bits, from the run's seed and the names of station and craft
(`swarm.random`), and two whole numbers; it is mixed by the finaliser of SplitMix64 (Steele, Lea, Flood 2014), whose
every output bit depends on every input bit.
"""

import numpy as np

from estimators.kernel import kernel
from swarm.random import Purpose

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_THIRTY, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


def key_of(seed: int, *names: int) -> np.uint64:
    """Return the key of the numbers of one station, or of one station and craft, in a run."""
    sequence = np.random.SeedSequence(seed, spawn_key=(*Purpose.SWEEP.value, *names))
    return np.uint64(sequence.generate_state(1, np.uint64)[0])


@kernel
def _mixed(x: np.uint64) -> np.uint64:
    """Return 64 bits each of which depends on each bit of `x`."""
    x = (x ^ (x >> _THIRTY)) * _FIRST
    x = (x ^ (x >> _27)) * _SECOND
    return x ^ (x >> _31)


@kernel
def uniform(key: np.uint64, first: int, second: int) -> float:
    """Return a number between 0 and 1, both excluded, by its name.

    Args:
        key: key of the station or craft.
        first: a whole number, such as that of a sweep.
        second: another one, such as that of a photodiode.
    """
    bits = _mixed(key + np.uint64(first) * _GOLDEN)
    bits = _mixed(bits + np.uint64(second + 1) * _GOLDEN)
    return (float(bits >> _11) + 0.5) / 9007199254740992.0


@kernel
def normal(key: np.uint64, first: int, second: int) -> float:
    """Return a standard normal number by its name (Box and Muller 1958).

    Args:
        key: key of the station or craft.
        first: a whole number, such as that of a sweep.
        second: another one, such as that of a photodiode.
    """
    radius = np.sqrt(-2.0 * np.log(uniform(key, first, 2 * second)))
    return float(radius * np.cos(2.0 * np.pi * uniform(key, first, 2 * second + 1)))

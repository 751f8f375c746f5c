"""Sums of random tones: smooth random signals, band-limited, that never leave their bounds.

A signal is a sum of N tones of one and the same speed, random in frequency and phase:

    x(t) = sum_j (v / w_j) sin(w_j t + phi_j),    v = s sqrt(2 / N)

whose derivative is s in RMS. One frequency is drawn in each of N equal stretches of the logarithm between the lowest
frequency and the bandwidth. The lowest is such that all tones together just reach the bound:

    sum_j v / w_j = bound

Where even equal frequencies at the bandwidth reach further than the bound, there is no such motion.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from estimators.arrays import Floats
from swarm.errors import SwarmError

TONES = 8
LOWEST = 1e-9
"""Lowest frequency over the bandwidth that is looked for: a period of years, which no bound needs."""


class Tones(NamedTuple):
    """Signals (S,), each a sum of N tones: amplitude, frequency [rad/s] and phase [rad], (S, N)."""

    amplitude: Floats
    frequency: Floats
    phase: Floats

    def at(self, time_s: float) -> tuple[Floats, Floats, Floats]:
        """Return the signals (S,) at `time_s` [s], and their first and second derivatives."""
        angle = self.frequency * time_s + self.phase
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        return (
            sine.sum(axis=-1),
            (self.frequency * cosine).sum(axis=-1),
            -(self.frequency**2 * sine).sum(axis=-1),
        )


def tones(bound: Floats, speed: Floats, bandwidth_hz: float, rng: np.random.Generator) -> Tones:
    """Draw S signals that stay within their bounds; a signal of speed zero stays at zero.

    Args:
        bound: The largest absolute value of each signal, (S,).
        speed: The RMS of the derivative of each signal, (S,) [1/s].
        bandwidth_hz: The highest frequency [Hz].
        rng: The generator of the frequencies and phases.

    Raises:
        SwarmError: A signal that fast and no faster than the bandwidth leaves its bound.
    """
    signals = len(bound)
    place = (np.arange(TONES) + rng.random((signals, TONES))) / TONES
    phase = rng.uniform(0, 2 * np.pi, (signals, TONES))
    highest = 2 * np.pi * bandwidth_hz
    amplitude, frequency = np.zeros((signals, TONES)), np.full((signals, TONES), highest)
    for i in range(signals):
        if speed[i] == 0:
            continue
        each = speed[i] * np.sqrt(2 / TONES)
        least = TONES * each / highest
        if least > bound[i]:
            raise SwarmError(
                f"wander: a speed of {speed[i]:.3g} per second cannot stay within {bound[i]:.3g} of the middle at "
                f"bandwidth_hz = {bandwidth_hz:g}: more room, less speed, or more bandwidth"
            )

        def excess(ratio: float, i: int = i, each: float = each) -> float:
            return float(np.sum(each / (highest * ratio ** place[i])) - bound[i])

        ratio = 1.0 if least == bound[i] else float(brentq(excess, LOWEST, 1.0, xtol=1e-15, rtol=1e-12))
        frequency[i] = highest * ratio ** place[i]
        amplitude[i] = each / frequency[i]
    return Tones(amplitude, frequency, phase)

"""Surveys with a known answer: poses strewn over the field, angles by `estimators.lighthouse.sweep.measured_theta`."""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.calibration.problem import Noise, Survey
from estimators.lighthouse.sweep import FanErrors, FanPair, measured_theta

PERFECT: FanPair = (FanErrors(), FanErrors())
REAL: FanPair = (
    FanErrors(0.041, -0.0093, 0.0021, 1.81, 0.0104),
    FanErrors(-0.037, 0.0081, -0.0019, -1.17, 0.0087),
)
NOISE = Noise(own_rad=15.3e-6, rotor_rad=39.8e-6)
"""Source 1's 8.8 arcsec with rho = 0.8717."""
LAYOUT = (
    np.array(
        [
            [18.0, 18.0, 38.0],
            [-18.0, 18.0, 38.0],
            [-18.0, -18.0, 38.0],
            [55.9, 8.0, 8.2],
            [14.0, 38.9, 25.2],
            [-47.4, -16.0, 16.7],
            [6.0, -33.2, 30.9],
            [41.2, 41.2, 7.7],
            [-41.2, -41.2, 7.7],
        ]
    )
    / 1e3
)


class Truth(NamedTuple):
    """What a calibration is to find."""

    fans: FanPair
    point_m: Floats
    rotation: Floats
    position: Floats


def strewn(count: int, seed: int, spread: float = 1.0) -> tuple[Floats, Floats]:
    """Rotations (N, 3, 3), front towards the lighthouse, and positions (N, 3) within `spread` of the whole field."""
    random = np.random.default_rng(seed)
    depth = random.uniform(1.0, 3.0, count)
    off = np.tan(np.radians(50) * random.uniform(-1, 1, (count, 2)) * spread)
    middle = np.array([0.0, 0.0, 2.0])
    place = np.stack([depth * off[:, 0], depth * off[:, 1], depth], axis=1)
    place = middle + (place - middle) * min(1.0, 4 * spread)
    turned = np.diag([1.0, -1.0, -1.0]) @ rot.exp(random.normal(0, 0.35 * spread, (count, 3)))
    spin = rot.exp(random.uniform(-np.pi, np.pi, (count, 1)) * spread * np.array([0.0, 0.0, 1.0]))
    return turned @ spin, place


def survey(
    poses: int,
    *,
    seed: int = 1,
    fans: FanPair = REAL,
    mounting_m: float = 5e-4,
    noise: Noise = NOISE,
    noisy: bool = True,
    spread: float = 1.0,
    speed: float = 0.3,
    crafts: int = 1,
) -> tuple[Survey, Truth]:
    """A survey and its truth: each period each craft at a pose of its own; start values perfect fans, drawn layout."""
    random = np.random.default_rng([seed, 1])
    rotation, position = strewn(poses * crafts, seed, spread)
    count, photodiodes = poses * crafts, len(LAYOUT)
    craft, period = np.tile(np.arange(crafts), poses), np.repeat(np.arange(poses), crafts)
    velocity, rate = random.normal(0, speed, (2, count, 3))
    believed = np.tile(LAYOUT, (crafts, 1))
    true = believed + mounting_m * random.standard_normal(believed.shape)
    lit = random.random((count, photodiodes)) < 0.8
    pose, k, fan = (i.ravel() for i in np.indices((count, photodiodes, 2)))
    kept = lit[pose, k]
    pose, k, fan = pose[kept], k[kept], fan[kept]
    point = craft[pose] * photodiodes + k
    offset = np.array([-1, 1])[fan] / 240 + random.normal(0, 2e-4, len(fan))
    body = np.einsum("mij,mj->mi", rotation[pose], true[point])
    moved = np.einsum("mij,mj->mi", rot.exp(rate[pose] * offset[:, None]), body)
    at = moved + position[pose] + velocity[pose] * offset[:, None]
    theta = measured_theta(at, fans)[np.arange(len(fan)), fan]
    if noisy:
        theta += noise.rotor_rad * random.standard_normal((poses, 2))[period[pose], fan]
        theta += noise.own_rad * random.standard_normal(len(fan))
    made = Survey(
        theta=theta,
        fan=fan,
        photodiode=point,
        pose=pose,
        offset_s=offset,
        rotation=rotation,
        position=position,
        angular_rate=rate,
        velocity=velocity,
        craft=craft,
        period=period,
        point_m=believed,
        owner=np.repeat(np.arange(crafts), photodiodes),
        fans=np.zeros((2, 5)),
    )
    return made, Truth(fans, true, rotation, position)

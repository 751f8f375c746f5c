"""Random streams: independent by seed, purpose and number, and the same in whatever order they are asked for."""

from collections import Counter
from zlib import crc32

import numpy as np

from swarm import random
from swarm.random import Purpose


def test_a_stream_is_numpys_own_for_its_spawn_key():
    """The bits of runs hang on it: numpy's generator for this seed and spawn key."""
    expected = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0x4C48, 0, 99, 3))).random(5)
    assert np.array_equal(random.stream(7, Purpose.MOUNTING, 99, 3).random(5), expected)


def test_no_two_purposes_share_a_stream():
    first = {purpose: random.stream(1, purpose, 5, 2).random() for purpose in Purpose}
    assert Counter(first.values()).most_common(1)[0][1] == 1
    assert len({random.stream(seed, Purpose.PUSH).random() for seed in range(20)}) == 20


def test_a_key_follows_from_the_name_alone():
    assert random.key("chaser") == crc32(b"chaser")
    assert random.keys(["chaser", "target"]) == [random.key("chaser"), random.key("target")]

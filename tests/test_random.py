"""Random streams: independent by seed, purpose and number, and the same in whatever order they are asked for."""

from collections import Counter
from zlib import crc32

import numpy as np

from swarm import random
from swarm.random import Blocks, Purpose


def test_a_stream_is_numpys_own_for_its_spawn_key():
    """The bits of runs hang on it: numpy's generator for this seed and spawn key."""
    expected = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0x4C48, 4, 99, 3))).random(5)
    assert np.array_equal(random.stream(7, Purpose.ANGLE, 99, 3).random(5), expected)


def test_no_two_purposes_share_a_stream():
    first = {purpose: random.stream(1, purpose, 5, 2).random() for purpose in Purpose}
    assert Counter(first.values()).most_common(1)[0][1] == 1
    assert len({random.stream(seed, Purpose.PUSH).random() for seed in range(20)}) == 20


def test_a_key_follows_from_the_name_alone():
    assert random.key("chaser") == crc32(b"chaser")
    assert random.keys(["chaser", "target"]) == [random.key("chaser"), random.key("target")]


def test_blocks_give_a_frame_the_same_draws_in_any_order():
    def drawn(frames):
        blocks = Blocks(4, lambda block: random.stream(3, Purpose.PUSH, block).random(4))
        return {frame: at[0][at[1]] for frame in frames for at in [blocks.at(frame)]}

    forth, back = drawn(range(12)), drawn(reversed(range(12)))
    assert forth == back
    assert len(set(forth.values())) == 12


def test_a_block_is_drawn_once_while_it_lasts():
    asked = []
    blocks = Blocks(3, lambda block: asked.append(block))
    for frame in range(7):
        blocks.at(frame)
    assert asked == [0, 1, 2]

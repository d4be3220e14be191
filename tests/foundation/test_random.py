"""Counter-based random numbers: the published vectors, purity, symmetry, ends of the interval, independence."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from scipy import stats

from chemage.plugin import random as cr

# Random123 1.14, tests/kat_vectors, "philox4x32 10": counter, key, expected output.
KNOWN_ANSWERS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("counter", "words", "expected"), KNOWN_ANSWERS)
def test_the_published_known_answers_are_reproduced(counter, words, expected):
    assert cr.philox(*(np.uint64(w) for w in counter + words)) == expected


def test_doubles_exclude_both_ends_of_the_interval():
    last = np.uint64(0xFFFFFFFF)
    assert cr.to_double(np.uint64(0), np.uint64(0)) == 2.0**-53
    assert cr.to_double(last, last) == 1.0 - 2.0**-53


def test_the_counter_layout_is_the_documented_one():
    k0, k1 = cr.key(7)
    index, block, stream = (5 << 32) | 9, (3 << 32) | 11, 300
    words = cr.philox(*(np.uint64(w) for w in (9, 5, 11, 300 | (3 << 16), int(k0), int(k1))))
    expected = cr.to_double(words[0], words[1]), cr.to_double(words[2], words[3])
    assert cr.uniform_pair(k0, k1, stream, index, block) == expected
    assert cr.uniforms(7, stream, [index], 2 * block + 1)[0] == expected[1]


def test_a_number_depends_on_its_own_index_only():
    index = np.array([[5, 2**40, 0], [17, 3, 2**62]])
    together = cr.uniforms(3, cr.FORMING, index, 4)
    for position in np.ndindex(index.shape):
        assert cr.uniforms(3, cr.FORMING, index[position], 4) == together[position]
    assert cr.uniforms(3, cr.FORMING, index[::-1, ::-1], 4).tobytes() == together[::-1, ::-1].tobytes()


def test_seed_stream_index_and_draw_all_matter():
    base = cr.uniforms(1, cr.FORMING, np.arange(64))
    others = [
        cr.uniforms(2, cr.FORMING, np.arange(64)),
        cr.uniforms(1, cr.BREAKING, np.arange(64)),
        cr.uniforms(1, cr.FORMING, np.arange(64) + 2**32),
        cr.uniforms(1, cr.FORMING, np.arange(64), 1),
        cr.uniforms(1, cr.FORMING, np.arange(64), 2),
        cr.uniforms(1, cr.FORMING, np.arange(64), 2**33),
        cr.pair_uniforms(1, cr.FORMING, np.arange(64), np.zeros(64, int)),
    ]
    stacked = np.stack([base, *others])
    assert np.unique(stacked).size == stacked.size


def test_pairs_are_symmetric_and_distinct():
    one, two = (grid.ravel() for grid in np.meshgrid([0, 1, 7, 2**32, 2**48 - 1], [0, 2, 7, 2**33, 2**47]))
    values = cr.pair_uniforms(5, cr.PAIR, one, two)
    assert values.tobytes() == cr.pair_uniforms(5, cr.PAIR, two, one).tobytes()
    unordered = {(min(a, b), max(a, b)) for a, b in zip(one.tolist(), two.tolist(), strict=True)}
    assert np.unique(values).size == len(unordered)
    assert cr.pair_uniforms(5, cr.PAIR, 3, np.arange(4)).shape == (4,)


def test_keys_come_from_seed_sequences_and_leave_them_alone():
    root = np.random.SeedSequence(11)
    assert cr.key(root).tolist() == cr.key(11).tolist() == cr.key(root).tolist()
    children = [tuple(cr.key(child)) for child in root.spawn(100)]
    assert len(set(children)) == 100
    assert cr.key(cr.key(11)).tolist() == cr.key(11).tolist()
    assert cr.key(np.int32(11)).tolist() == cr.key(11).tolist()


def test_threads_give_the_same_bytes():
    index = np.arange(20000)
    expected = cr.uniforms(9, cr.KINETICS, index).tobytes()
    results: dict[int, bytes] = {}

    def draw(worker: int) -> None:
        results[worker] = cr.uniforms(9, cr.KINETICS, index).tobytes()

    workers = [threading.Thread(target=draw, args=(number,)) for number in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert [results[number] for number in range(4)] == [expected] * 4


def test_numbers_are_uniform_and_neighbouring_counters_are_uncorrelated():
    values = cr.uniforms(4, cr.FORMING, np.arange(200_000))
    assert values.min() > 0.0
    assert values.max() < 1.0
    counts = np.histogram(values, 256, (0.0, 1.0))[0]
    assert 1e-4 < stats.chisquare(counts).pvalue < 1.0 - 1e-4
    for other in (np.roll(values, 1), np.roll(values, 1000), cr.uniforms(4, cr.FORMING, np.arange(200_000), 1)):
        assert abs(np.corrcoef(values, other)[0, 1]) < 4.5 / np.sqrt(values.size)


def test_empty_input_gives_empty_output():
    assert cr.uniforms(1, 1, []).shape == (0,)
    assert cr.pair_uniforms(1, 1, np.zeros((0, 8), int), np.zeros((0, 8), int)).shape == (0, 8)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: cr.key(-1), "negative"),
        (lambda: cr.key(1.5), "neither"),  # type: ignore[arg-type]
        (lambda: cr.key(True), "whole number"),
        (lambda: cr.key(np.arange(3)), "key"),
        (lambda: cr.uniforms(1, -1, [0]), "stream"),
        (lambda: cr.uniforms(1, 1 << 16, [0]), "stream"),
        (lambda: cr.uniforms(1, 1, [-3]), "-3"),
        (lambda: cr.uniforms(1, 1, [0.5]), "float64"),
        (lambda: cr.uniforms(1, 1, [0], -1), "draw"),
        (lambda: cr.pair_uniforms(1, 1, [1 << 48], [0]), "first"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()

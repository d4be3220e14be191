"""Counter-based random numbers: a pixel keeps its number whatever else is drawn, on any number of threads.

Every number is a pure function of a key (from a seed), a stream (what the number is for), an index (which pixel, which
event) and a draw (how many numbers that index has already used). Nothing is consumed in sequence, so results do not
depend on the order of evaluation, and one pixel keeps its disorder when the load, and with it the contact, changes.

The generator is Philox4x32 with ten rounds: Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as
1, 2, 3", Proc. SC'11 (2011), doi:10.1145/2063384.2063405. One block of its output makes two doubles.

The counter holds, from the lowest word: index bits 0-31, index bits 32-63, block bits 0-31, and block bits 32-46
above a stream of 16 bits; block = draw >> 1. Its top bit marks pairs, so that a pair and an index never share a block.
"""

from __future__ import annotations

import hashlib
import operator

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

from chemage.foundation.kernels import kernel

#: Streams in use; engines have KINETICS to KINETICS + 15 between them. A plugin that draws its own kind of number gets
#: a stream from `stream`.
FORMING = 1
BREAKING = 2
HYDROXYLATION = 3
PAIR = 4
TRANSITION = 5
KINETICS = 16
FIRST_FREE_STREAM = 256

LAST_STREAM = 0xFFFF
LAST_DRAW = (1 << 48) - 1
LAST_PAIR_INDEX = (1 << 48) - 1

#: a seed as users give it (a whole number, or one of numpy's seed sequences), or the two words that `key` made of one
Keyed = int | np.random.SeedSequence | NDArray[np.uint64]


class CommonSeed(np.random.SeedSequence):
    """A seed whose numbers runs have in common.

    An engine makes every run an independent sample, by hashing its seed with what it simulates. It must not do so with
    this one: two runs with equal ones take the same random numbers for the same things as far as they correspond.
    """


# numba promotes uint64 with a signed integer to float64, so every constant below is a uint64.
_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint64(0x9E3779B9)
_W1 = np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_BLOCK_TOP = np.uint64(0x7FFF)
_PAIR_BIT = np.uint64(0x80000000)
_S1 = np.uint64(1)
_S12 = np.uint64(12)
_S16 = np.uint64(16)
_S20 = np.uint64(20)
_S32 = np.uint64(32)
# 52 bits, not 53: k + 1/2 is exact only below 2**52, and rounding it up could return 1.0.
_ULP = 2.0**-52


@nb.njit(nogil=True)
def philox(c0, c1, c2, c3, k0, k1):
    """Ten rounds of Philox4x32: four counter words and two key words (uint64 below 2**32) to four such words."""
    for _ in range(10):
        p0 = _M0 * c0
        p1 = _M1 * c2
        c0, c1, c2, c3 = (
            (p1 >> _S32) ^ c1 ^ k0,
            p1 & _LOW,
            (p0 >> _S32) ^ c3 ^ k1,
            p0 & _LOW,
        )
        k0 = (k0 + _W0) & _LOW
        k1 = (k1 + _W1) & _LOW
    return c0, c1, c2, c3


@nb.njit(nogil=True)
def to_double(high, low):
    """Two words below 2**32 to a double (k + 1/2) 2**-52, k of 52 bits: at least 2**-53, at most 1 - 2**-53."""
    return (np.float64((high << _S20) | (low >> _S12)) + 0.5) * _ULP


@nb.njit(nogil=True)
def uniform_pair(k0, k1, stream, index, block):
    """Draws 2*block and 2*block + 1 of one index: two doubles in (0, 1). For use inside kernels.

    `k0`, `k1` are the two words of `key`; all of `stream`, `index` and `block` may be any integer type, not negative.
    """
    i = np.uint64(index)
    b = np.uint64(block)
    top = np.uint64(stream) | (((b >> _S32) & _BLOCK_TOP) << _S16)
    r0, r1, r2, r3 = philox(
        i & _LOW, i >> _S32, b & _LOW, top, np.uint64(k0), np.uint64(k1)
    )
    return to_double(r0, r1), to_double(r2, r3)


@nb.njit(nogil=True)
def uniform(k0, k1, stream, index, draw):
    """One double in (0, 1), the scalar form of `uniforms`. For use inside kernels."""
    d = np.uint64(draw)
    first, second = uniform_pair(k0, k1, stream, index, d >> _S1)
    return second if d & _S1 else first


@nb.njit(nogil=True)
def pair_uniform(k0, k1, stream, first, second):
    """One double in (0, 1) for an unordered pair of indices below 2**48, the scalar form of `pair_uniforms`."""
    a = np.uint64(min(first, second))
    b = np.uint64(max(first, second))
    tops = (a >> _S32) | ((b >> _S32) << _S16)
    r0, r1, _, _ = philox(
        a & _LOW,
        b & _LOW,
        tops,
        np.uint64(stream) | _PAIR_BIT,
        np.uint64(k0),
        np.uint64(k1),
    )
    return to_double(r0, r1)


@kernel(nogil=True)
def _fill(k0, k1, stream, index, draw, out):
    # One loop for each lane: without a branch inside, the rounds run on vector registers.
    block = draw >> _S1
    if draw & _S1:
        for i in range(index.size):
            out[i] = uniform_pair(k0, k1, stream, index[i], block)[1]
    else:
        for i in range(index.size):
            out[i] = uniform_pair(k0, k1, stream, index[i], block)[0]


@kernel(nogil=True)
def _fill_pairs(k0, k1, stream, first, second, out):
    for i in range(first.size):
        out[i] = pair_uniform(k0, k1, stream, first[i], second[i])


def key(seed: Keyed) -> NDArray[np.uint64]:
    """The two 32-bit key words of a seed, as uint64, shape (2,).

    A whole number or a `numpy.random.SeedSequence` is hashed by the seed sequence (which is left as it was: the same
    sequence always gives the same key, and spawned children give different ones). A key is returned unchanged.
    Raises ValueError for a negative number and TypeError for anything else.
    """
    if isinstance(seed, np.ndarray):
        if (
            seed.shape != (2,)
            or seed.dtype != np.uint64
            or int(seed.max()) > 0xFFFFFFFF
        ):
            raise ValueError(
                "seed: an array must be a key as `chemage.plugin.random.key` returns it; give a whole number"
            )
        return seed
    if not isinstance(seed, np.random.SeedSequence):
        if isinstance(seed, (bool, np.bool_)):
            raise TypeError(f"seed: {seed!r} is not a whole number")
        try:
            number = operator.index(seed)
        except TypeError:
            raise TypeError(
                f"seed: {seed!r} is neither a whole number nor a numpy SeedSequence"
            ) from None
        if number < 0:
            raise ValueError(
                f"seed: {number} is negative; give a whole number from 0 up"
            )
        seed = np.random.SeedSequence(number)
    return seed.generate_state(2, np.uint32).astype(np.uint64)


#: number of a stream -> what has claimed it
_claimed: dict[int, str] = {}


def stream(name: str) -> int:
    """The stream of a plugin's own random numbers: a pure function of ``name``, such as ``"chemage-oxide/defects"``.

    Raises
    ------
    ValueError
        Another name has the same stream in this process; choose another name.
    """
    if not name:
        raise ValueError(
            "name = '': a stream needs a name, such as 'my-plugin/defects'"
        )
    free = LAST_STREAM + 1 - FIRST_FREE_STREAM
    number = (
        FIRST_FREE_STREAM
        + int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest())
        % free
    )
    other = _claimed.setdefault(number, name)
    if other != name:
        raise ValueError(
            f"name = {name!r}: its stream {number} belongs to {other!r} already; choose another name"
        )
    return number


def _stream(stream: int) -> int:
    number = operator.index(stream)
    if not 0 <= number <= LAST_STREAM:
        raise ValueError(f"stream: {number} is outside 0 to {LAST_STREAM}")
    return number


def _indices(name: str, values: ArrayLike, last: int) -> NDArray[np.int64]:
    array = np.asarray(values)
    if array.size == 0:
        return np.zeros(array.shape, np.int64)
    if array.dtype.kind not in "iu":
        raise TypeError(
            f"{name}: an array of {array.dtype} where whole numbers are needed"
        )
    low, high = int(array.min()), int(array.max())
    if low < 0 or high > last:
        raise ValueError(
            f"{name}: {low if low < 0 else high} is outside 0 to {last}"
        )
    return np.ascontiguousarray(array, np.int64)


def uniforms(
    seed: Keyed, stream: int, index: ArrayLike, draw: int = 0
) -> NDArray[np.float64]:
    """Doubles in (0, 1), both ends excluded; one per index, a pure function of (seed, stream, index, draw).

    seed: as for `key`. stream: 0 to 65535, what the numbers are for. index: whole numbers from 0 up, any shape (a flat
    pixel index, as a rule). draw: which of the index's numbers, from 0 up. Returns float64 of the shape of `index`:
    (k + 1/2) 2**-52 with k uniform on 52 bits. Raises ValueError or TypeError on numbers that do not fit.
    """
    number = operator.index(draw)
    if not 0 <= number <= LAST_DRAW:
        raise ValueError(f"draw: {number} is outside 0 to {LAST_DRAW}")
    indices = _indices("index", index, np.iinfo(np.int64).max)
    words = key(seed)
    out = np.empty(indices.shape)
    _fill(
        words[0],
        words[1],
        np.uint64(_stream(stream)),
        indices.reshape(-1),
        np.uint64(number),
        out.reshape(-1),
    )
    return out


def pair_uniforms(
    seed: Keyed, stream: int, first: ArrayLike, second: ArrayLike
) -> NDArray[np.float64]:
    """Doubles in (0, 1), one per unordered pair of indices: `first` and `second` may be swapped anywhere.

    The two arrays have one shape, or broadcast to it; indices are from 0 to 2**48 - 1. Returns float64 of that shape.
    """
    one, two = np.broadcast_arrays(
        _indices("first", first, LAST_PAIR_INDEX),
        _indices("second", second, LAST_PAIR_INDEX),
    )
    words = key(seed)
    out = np.empty(one.shape)
    one, two = (
        np.ascontiguousarray(one).reshape(-1),
        np.ascontiguousarray(two).reshape(-1),
    )
    _fill_pairs(
        words[0], words[1], np.uint64(_stream(stream)), one, two, out.reshape(-1)
    )
    return out

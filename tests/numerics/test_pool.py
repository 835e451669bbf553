"""Arrays that are lent again where nobody holds them any more."""

from __future__ import annotations

import threading

import numpy as np

from leastaction.numerics.arrays import read_only
from leastaction.numerics.pool import Pool, copied, empty, zeros

SHAPE = (640, 3)


def test_what_somebody_holds_is_not_lent_again() -> None:
    pool = Pool()
    with pool:
        kept = read_only(copied(np.ones(SHAPE)))[3:, ::2]
        dropped = empty(SHAPE)
        memory = dropped.ctypes.data
        del dropped
        again = zeros(SHAPE)
        assert again.ctypes.data == memory
        assert not np.shares_memory(again, kept)
    np.testing.assert_array_equal(kept, 1.0)


def test_a_read_only_view_leaves_the_memory_writable() -> None:
    pool = Pool()
    with pool:
        array = empty(SHAPE)
        array.setflags(write=False)
        memory = array.ctypes.data
        del array
        array = empty(SHAPE)
        assert array.ctypes.data == memory
        array[...] = 1.0


def test_as_many_are_reserved_as_are_held() -> None:
    pool = Pool()
    with pool:
        held = [empty(SHAPE) for _ in range(3)]
        pool.reserve()
        more = {id(empty(SHAPE).base) for _ in range(3)}
    assert len(pool._arrays[SHAPE, np.float64]) == 6
    assert not more & {id(each.base) for each in held}


def test_other_threads_and_small_arrays_have_memory_of_their_own() -> None:
    pool, found = Pool(), []
    with pool:
        assert empty((3, 4)).base is None
        thread = threading.Thread(target=lambda: found.append(empty(SHAPE)))
        thread.start()
        thread.join()
        assert found[0].base is None
        inner = Pool()
        with inner:
            assert empty(SHAPE).base is inner._arrays[SHAPE, np.float64][0]
        assert empty(SHAPE).base is pool._arrays[SHAPE, np.float64][0]
    assert empty(SHAPE).base is None

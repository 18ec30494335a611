"""Caching of results that are made once for the same arguments."""

import pytest

from drivecomm.protocol import kept


def test_result_is_cached_by_value_and_type_of_the_arguments():
    made = []

    @kept
    def request(number, index=0):
        made.append((number, index))
        return [number, index]

    assert request(1) is request(1)
    assert request(1) is not request(True)
    assert request(2, index=3) == [2, 3]
    assert made == [(1, 0), (True, 0), (2, 3)]


def test_exception_is_not_cached():
    tries = []

    @kept
    def target(name):
        tries.append(name)
        raise KeyError(name)

    for _ in range(2):
        with pytest.raises(KeyError):
            target("no such name")
    assert len(tries) == 2


def test_cache_drops_the_oldest_of_600_results():
    made = []
    once = kept(made.append)
    for number in range(600):
        once(number)
    once(599)
    once(0)
    assert len(made) == 601

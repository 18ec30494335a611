"""What is made once for the same arguments."""

import pytest

from drivecomm.protocol import kept


def test_the_same_is_made_once_and_another_type_is_not_the_same():
    made = []

    @kept
    def request(number, index=0):
        made.append((number, index))
        return [number, index]

    assert request(1) is request(1)
    assert request(1) is not request(True)
    assert request(2, index=3) == [2, 3]
    assert made == [(1, 0), (True, 0), (2, 3)]


def test_what_could_not_be_made_is_tried_again():
    tries = []

    @kept
    def target(name):
        tries.append(name)
        raise KeyError(name)

    for _ in range(2):
        with pytest.raises(KeyError):
            target("no such name")
    assert len(tries) == 2


def test_no_more_is_kept_than_a_poll_plan_has():
    made = []
    once = kept(made.append)
    for number in range(600):
        once(number)
    once(599)
    once(0)
    assert len(made) == 601

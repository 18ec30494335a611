"""Times at which listeners receive changes: the first immediately, later ones in batches, large batches less often."""

import pytest

from drivecomm.server.observations import CurrentValue
from drivecomm.server.table import MANY_TOGETHER_S, TOGETHER_S, ValueTable


class NotifiedTable:
    """A table with simulated time, and the times and sizes of the batches that listeners received."""

    def __init__(self):
        self.now, self.waiting, self.batches = 0.0, [], []
        self.table = ValueTable(lambda after_s, call: self.waiting.append((self.now + after_s, call)))
        self.table.listen(lambda values, _: self.batches.append((round(self.now * 1000), len(values))))

    def put(self, count):
        for number in range(count):
            self.table.put_value(CurrentValue(time_s=1.0, drive="pump", name=str(number), reading=None, quality="bad"))

    def pass_until(self, until):
        while self.waiting and self.waiting[0][0] <= until:
            self.now, call = self.waiting.pop(0)
            call()
        self.now = until


@pytest.fixture
def told():
    return NotifiedTable()


def test_change_after_a_pause_is_sent_immediately(told):
    told.put(1)
    told.pass_until(0.0)
    assert told.batches == [(0, 1)]
    told.pass_until(1.0)
    assert not told.waiting
    told.put(1)
    told.pass_until(1.0)
    assert told.batches[1:] == [(1000, 1)]


def test_changes_in_quick_succession_are_sent_in_one_batch(told):
    told.put(1)
    told.pass_until(TOGETHER_S / 2)
    told.put(3)
    told.pass_until(TOGETHER_S)
    assert told.batches == [(0, 1), (2, 3)]


def test_batch_interval_grows_with_the_number_of_changes(told):
    told.put(4)
    told.pass_until(TOGETHER_S)
    told.put(3)
    told.pass_until(MANY_TOGETHER_S)
    told.put(1)
    told.pass_until(MANY_TOGETHER_S + TOGETHER_S)
    assert told.batches == [(0, 4), (4, 3), (6, 1)]

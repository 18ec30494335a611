"""Values of a drive gathered into one message: at intervals to save messages, immediately after a change of state."""

from drivecomm.line import STATUS
from drivecomm.server.mqtt.batching import EVERY_S, DriveBatches
from drivecomm.server.mqtt.content import PublishedValue
from drivecomm.server.mqtt.value_backfill import LOOKED_EVERY_S


def sample(drive, name, value, time_ms=0):
    return PublishedValue(drive, name, value, "", "", "good", "", time_ms)


def test_first_value_is_due_immediately_and_later_ones_at_the_interval():
    gathering = DriveBatches()
    first, second = (sample("pump", "output_frequency", number) for number in range(2))
    third = sample("pump", "torque", 2)
    gathering.add([first])
    assert gathering.due(10.0) == [[first]]
    gathering.add([second])
    assert gathering.due(10.0 + EVERY_S / 2) == []
    gathering.add([third])
    assert gathering.due(10.0 + EVERY_S) == [[second, third]]
    assert gathering.due(20.0) == []


def test_history_interval_is_longer_than_the_gathering_interval():
    # A value found in the history before its live message is sent would be published twice.
    assert LOOKED_EVERY_S > EVERY_S


def test_each_drive_has_its_own_interval():
    gathering = DriveBatches()
    gathering.add([sample("pump", "torque", 1)])
    gathering.due(10.0)
    later = sample("fan", "torque", 2)
    gathering.add([sample("pump", "torque", 3), later])
    assert gathering.due(10.1) == [[later]]


def test_changed_state_is_due_immediately_with_the_gathered_values():
    gathering = DriveBatches()
    gathering.add([sample("pump", STATUS, "ready")])
    gathering.due(10.0)
    again, value, running = (
        sample("pump", STATUS, "ready"),
        sample("pump", "torque", 1),
        sample("pump", STATUS, "running"),
    )
    gathering.add([again, value])
    assert gathering.due(10.1) == []
    gathering.add([running])
    assert gathering.due(10.1) == [[again, value], [running]]


def test_changed_state_alone_is_due_immediately():
    gathering = DriveBatches()
    gathering.add([sample("pump", STATUS, "ready")])
    gathering.due(10.0)
    running = sample("pump", STATUS, "running")
    gathering.add([running])
    assert gathering.due(10.1) == [[running]]


def test_no_gathered_value_is_replaced_by_the_next():
    gathering = DriveBatches()
    gathering.add([sample("pump", "torque", 0)])
    gathering.due(10.0)
    one, other, two = sample("pump", "torque", 1), sample("pump", "output_power", 5), sample("pump", "torque", 2)
    fan = sample("fan", "torque", 3)
    gathering.add([one, other])
    assert gathering.due(10.1) == []
    gathering.add([two, fan])
    assert gathering.due(10.1) == [[one, other, fan], [two]]

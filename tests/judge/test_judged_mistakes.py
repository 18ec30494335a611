"""Masters with one planted mistake each: each is found by its case, with the right reason."""

import pytest

pytestmark = [pytest.mark.soak, pytest.mark.timeout(120)]

MISTAKES = [
    ("checksum", "read", "read-damaged", "accepted a damaged reply"),
    ("cut", "read", "read-cut", "accepted a truncated reply"),
    ("address", "read", "read-other-drive", "that value is from another drive"),
    ("parameter", "read", "read-other-question", "the reply to another request"),
    ("error", "read", "read-refused-11", "ignored an error code"),
    ("refused", "read", "read-refused-11", "although the drive had refused it"),
    ("attempts", "read", "read-lost-once", "gave up after one reply was lost"),
    ("scale", "read", "read-plain", "does not show what the drive holds"),
    ("late", "read", "read-late", "accepted a late reply"),
    ("attempts flush parameter", "read two", "read-late", "accepted a wrong value"),
    ("flush", "poll", "read-late", "accepted old replies"),
    ("flush", "poll", "read-doubled", "accepted old replies"),
    ("gives_up", "poll", "read-off-on", "it gave up"),
    ("start", "start", "start-lost", "sent the start again"),
    ("register", "start", "start-after-refusal", "has no effect"),
    ("restarts", "keep", "run-power-cycle", "started the motor by itself after a power cycle"),
    ("stop", "stop", "stop-lost", "did not repeat the stop"),
    ("stop", "stop", "stop-unheard", "the motor keeps running"),
    ("ask_first", "stop", "stop-mute", "never went out"),
    ("error", "write", "write-refused-1", "ignored an error code"),
    ("silent", "write", "write-refused-1", "ignored an error code"),
    ("refused", "write", "write-refused-1", "although the drive had refused it"),
    ("eeprom", "write", "write-stored", "writes EEPROM in a loop"),
    ("confirmed", "write", "write-lost", "treats the write as done"),
    ("pause", "start", "start-timing", "does not keep to the timing"),
    ("pause", "poll", "read-timing", "does not keep to the timing"),
    ("settings", "read", "read-settings", "line settings are wrong"),
    ("clamp", "write", "write-ends", "clamped or cut silently"),
    ("wrap", "write", "write-ends", "clamped or cut silently"),
]


@pytest.mark.parametrize(("mistake", "task", "case", "reason"), MISTAKES, ids=lambda each: str(each).replace(" ", "-"))
def test_mistake_fails_its_case_with_its_reason(verdicts, mistake, task, case, reason):
    verdict = verdicts(task, cases=[case], mistake=mistake)[case]
    assert verdict.outcome == "failed", verdict.reason
    assert reason in verdict.reason
    assert verdict.trace

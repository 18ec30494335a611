"""The stats command: polls drives for a while and prints counters and reply times."""

import pytest

from drivecomm.link import COUNTERS, REPLY_TIME_BOUNDS_MS
from drivecomm.plant import Fault, FaultPlan
from drivecomm.virtual import VirtualLine, virtual_drive


def rows_of(text):
    """Return the rows of the first table by their first cell."""
    cells = [
        [cell.strip() for cell in row.strip("|").split("|")]
        for row in text.split("\n\n")[0].splitlines()
        if row.startswith("|")
    ]
    return {row[0]: row[1:] for row in cells}


def test_stats_prints_each_drive_and_the_total(shell):
    shell.line(virtual_drive("vabus", 1), virtual_drive("danfoss-fc", 3))
    assert shell("stats", "vabus:1", "danfoss-fc:3", "--for", "2") == 0
    counters, times, *histograms = shell.out.split("\n\n")
    heads = ["requests", "replies", "retries", "timeouts", "damaged", "replies/s"]
    table = rows_of(counters)
    assert table["drive"] == heads, "what never happened has no column"
    both = [dict(zip(heads, table[name], strict=True)) for name in ("vabus:1", "danfoss-fc:3")]
    for one in both:
        assert int(one["requests"]) == int(one["replies"]) > 5
        assert float(one["replies/s"]) == pytest.approx(int(one["replies"]) / 2, rel=0.05)
    assert int(table["all"][0]) == sum(int(one["requests"]) for one in both)
    assert set(rows_of(times)) == {"reply times", "vabus:1", "danfoss-fc:3", "all"}
    assert [text.splitlines()[0] for text in histograms] == [
        "reply times of vabus:1",
        "reply times of danfoss-fc:3",
        "reply times of all",
    ]
    assert all("####" in text for text in histograms)


def test_single_drive_has_no_total(shell):
    shell.line()
    assert shell("stats", "vabus:1", "--for", "1") == 0
    assert "all" not in rows_of(shell.out)


def test_stats_prints_json(shell):
    shell.line(virtual_drive("vabus", 1))
    assert shell("stats", "vabus:1", "vabus:2", "--for", "3", "--json") == 1
    alive, dead, bus = shell.objects
    assert (alive["drive"], alive["answered"]) == ("vabus:1", True)
    assert (dead["drive"], dead["answered"], dead["reply_times"]) == ("vabus:2", False, None)
    assert list(alive["counters"]) == list(COUNTERS)
    assert dead["counters"]["timeouts"] == dead["counters"]["requests"] > 0
    assert 0 < dead["counters"]["probes"] < dead["counters"]["requests"], "given up, and asked again"
    assert bus["bus"] == "line"
    for name in COUNTERS:
        assert bus["counters"][name] == alive["counters"][name] + dead["counters"][name]
    times = alive["reply_times"]
    assert times["count"] == alive["counters"]["replies"] == sum(each["count"] for each in times["classes"])
    assert [each["up_to_ms"] for each in times["classes"]] == [*REPLY_TIME_BOUNDS_MS, None]
    assert times["shortest_ms"] <= times["p50_ms"] <= times["p95_ms"] <= times["p99_ms"] <= times["longest_ms"]


@pytest.mark.soak
def test_dead_drives_barely_slow_down_a_live_drive(shell):
    shell.line(virtual_drive("vabus", 1))
    shell("stats", "vabus:1", "--for", "60", "--json")
    alone = shell.objects[0]["counters"]["replies"]
    assert shell("stats", "vabus:1", "vabus:2", "vabus:3", "--for", "60", "--json") == 1
    assert shell.objects[0]["counters"]["replies"] > 0.9 * alone


def test_stats_of_a_dead_drive_ends_in_time(shell):
    line = shell.line()
    assert shell("stats", "vabus:7", "--for", "10") == 1
    assert 10 <= line.time < 10.6
    assert rows_of(shell.out)["vabus:7"][1] == "0"


@pytest.mark.soak
def test_stats_without_a_drive_scans_the_line_first(shell):
    shell.line(virtual_drive("fuji", 4), virtual_drive("vlt3500", 2))
    assert shell("stats", "--for", "1", "--json") == 0
    assert [each.get("drive") for each in shell.objects] == ["fuji:4", "vlt3500:2", None]
    assert all(each["counters"]["timeouts"] == 0 for each in shell.objects), "the scan's questions do not count"
    assert "scanned first" in shell.err


def test_stats_exits_with_1_if_no_drive_is_found(shell):
    shell.lines["line"] = VirtualLine()
    assert shell("stats", "--for", "1") == 1
    assert "no drive found" in shell.err


@pytest.mark.soak
def test_errors_get_columns_of_their_own(shell):
    faults = FaultPlan(rate=0.3, seed=1, kinds=[Fault.CORRUPT, Fault.DUPLICATE], requests=False)
    shell.line(virtual_drive("vabus", 1), echo=True, faults=faults)
    assert shell("stats", "vabus:1", "--for", "60", "--echo") == 0
    heads = rows_of(shell.out)["drive"]
    assert {"checksum errors", "echo bytes", "unasked bytes"} <= set(heads)
    assert int(rows_of(shell.out)["vabus:1"][heads.index("echo bytes")]) > 0


def fail_after(number, error):
    """Return a line that raises the error at transmission number `number`."""

    class Failing(VirtualLine):
        sent = 0

        def transmit(self, data):
            self.sent += 1
            if self.sent == number:
                raise error
            super().transmit(data)

    return Failing([virtual_drive("vabus", 1)])


def test_counters_are_printed_if_the_line_breaks(shell):
    line = shell.lines["line"] = VirtualLine([virtual_drive("vabus", 1)])
    hear = line.drives[0].hear
    heard = []

    def hear_ten(find, now):
        heard.append(find)
        line.broken = len(heard) > 10
        return hear(find, now)

    line.drives[0].hear = hear_ten
    assert shell("stats", "vabus:1", "--for", "5") == 3
    assert int(rows_of(shell.out)["vabus:1"][1]) > 0
    assert "broken" in shell.err


def test_counters_are_printed_on_ctrl_c(shell):
    shell.lines["line"] = fail_after(20, KeyboardInterrupt())
    assert shell("stats", "vabus:1", "--for", "5") == 130
    assert int(rows_of(shell.out)["vabus:1"][1]) > 5
    assert shell.err == "drivecomm: interrupted\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["vabus:1", "--for", "0"], "--for"),
        (["vabus:1", "--for", "-3"], "--for"),
        (["vabus:1", "--for", "nan"], "--for"),
        (["vabus"], "PROTOCOL:ADDRESS"),
        (["vabus:99"], "no drive at address 99"),
        (["profibus:1"], "profibus"),
    ],
)
def test_stats_refuses_wrong_arguments(shell, arguments, sentence):
    shell.line()
    assert shell("stats", *arguments) == 2
    assert sentence in shell.err
    assert shell.err.count("\n") == 1

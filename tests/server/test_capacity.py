"""Connection limits of a server's doors, derived from the limits of the system."""

import resource
import subprocess
import sys

import pytest
from hypothesis import given, strategies as st

from drivecomm.server import LOCAL_BOUNDS, Bounds, needed_descriptors, share_connections
from drivecomm.server.capacity import OF_DOOR, OF_LINE, OF_SERVER, SystemLimits, memory_limit

HTTP, OPCUA, MODBUS = Bounds(4000, 1000), Bounds(200, 50), Bounds(64, 32)


def test_doors_get_their_wished_limits_if_the_system_allows():
    wishes = [HTTP, OPCUA, MODBUS]
    enough = needed_descriptors(wishes, lines=10, doors=3)
    assert share_connections(SystemLimits(enough), wishes, lines=10, doors=3) == (LOCAL_BOUNDS, wishes)
    assert share_connections(SystemLimits(), wishes, lines=10, doors=3) == (LOCAL_BOUNDS, wishes)


def test_small_wish_of_a_door_leaves_more_for_the_others():
    local, (http, opcua, modbus) = share_connections(SystemLimits(1024), [HTTP, OPCUA, MODBUS], lines=2, doors=3)
    assert (local, opcua, modbus) == (Bounds(114, 114), OPCUA, MODBUS)
    assert http == Bounds(1024 - OF_SERVER - 2 * OF_LINE - 4 * OF_DOOR - 114 - 200 - 64, 133)


@given(st.integers(256, 5000), st.integers(0, 4), st.lists(st.sampled_from([HTTP, OPCUA, MODBUS]), max_size=4))
def test_connection_limits_leave_descriptors_for_lines_and_files(descriptors, lines, wishes):
    doors = len(wishes)
    local, shares = share_connections(SystemLimits(descriptors), wishes, lines=lines, doors=doors)
    rest = OF_SERVER + OF_LINE * lines + OF_DOOR * (doors + 1)
    assert local.most + sum(each.most for each in shares) + rest <= descriptors
    assert all(1 <= each.of_address <= each.most for each in shares)


def test_little_memory_bounds_connections_as_well():
    local, (http,) = share_connections(SystemLimits(100_000, 64 * 2**20), [HTTP], lines=1, doors=1)
    assert local.most + http.most == 128


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("0::/system/drives\n", {"system/memory.max": "1000000", "system/drives/memory.max": "max"}, 1_000_000),
        ("0::/system/drives\n", {"system/memory.max": "1000", "system/drives/memory.max": "500"}, 500),
        ("0::/of/the/host\n", {"memory.max": "2000"}, 2000),
        ("0::/\n", {}, None),
        ("4:memory:/drives\n1:name=systemd:/x\n", {"memory/drives/memory.limit_in_bytes": "3000"}, 3000),
        ("4:memory:/drives\n", {"memory/drives/memory.limit_in_bytes": "9223372036854771712"}, None),
    ],
)
def test_memory_limit_is_the_smallest_of_the_control_groups(tmp_path, groups, files, expected):
    told = tmp_path / "cgroup"
    told.write_text(groups)
    for name, text in files.items():
        file = tmp_path / "mounted" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    assert memory_limit(told, tmp_path / "mounted") == expected


def test_memory_limit_is_unknown_without_control_groups(tmp_path):
    assert memory_limit(tmp_path / "none", tmp_path) is None


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit")
@pytest.mark.parametrize(("soft", "hard", "expected"), [(100, 400, 300), (100, 200, 200), (350, 400, 350)])
def test_soft_limit_of_open_files_is_raised_as_far_as_needed(soft, hard, expected):
    asked = "from drivecomm.server import system_limits; print(system_limits(300).descriptors)"
    done = subprocess.run(
        [sys.executable, "-c", asked], check=True, capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard)),
    )  # fmt: skip
    assert int(done.stdout) == expected

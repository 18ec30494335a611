"""The plug-in inside pytest: cost for projects that do not use it, trace of a failed test, and clean-up."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

needs_pty = pytest.mark.skipif(os.name != "posix", reason="this system has no pseudo-terminals")

PASSES = """
    import drivecomm

    def test_a(virtual_line):
        line = virtual_line(["vabus:1"])
        with drivecomm.open_bus(line.port) as bus:
            bus.drive("vabus", 1, model="agile").read("481")
        line.drive("vabus:1").assert_received(kind="enquiry", parameter=481)
"""
FAILS = PASSES + "        assert False\n"


class TestLoadedOnlyWhenUsed:
    WATCH = """
        import sys

        def pytest_unconfigure():
            loaded = {name.partition(".")[0] for name in sys.modules}
            heavy = {"construct", "serial", "rich", "click", "drivecomm", "tomllib"}
            print("loaded:", sorted(name for name in loaded if name in heavy or name.startswith("drivecomm_")))
            print("plug-in:", "pytest_drivecomm" in loaded)
    """

    def run(self, pytester, folder, test):
        pytester.makeconftest(self.WATCH)
        pytester.makepyfile(test)
        path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
        return subprocess.run(
            [sys.executable, "-m", "pytest", "-s", "-p", "no:cacheprovider"],
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        ).stdout

    @pytest.mark.soak
    def test_run_without_fixtures_imports_nothing_of_drivecomm(self, pytester, plugin_folder):
        output = self.run(pytester, plugin_folder, "def test_a(): pass")
        assert "1 passed" in output
        assert "plug-in: True" in output
        assert "loaded: []" in output

    @pytest.mark.soak
    def test_run_with_a_fixture_imports_only_its_protocol(self, pytester, plugin_folder):
        output = self.run(pytester, plugin_folder, PASSES)
        assert "1 passed" in output
        assert "drivecomm_vabus" in output
        assert "drivecomm_fuji" not in output

    def test_plugin_import_takes_less_than_five_milliseconds(self):
        code = (
            "import sys, time, pytest\n"
            "def took():\n"
            "    sys.modules.pop('pytest_drivecomm', None)\n"
            "    began = time.perf_counter()\n"
            "    import pytest_drivecomm\n"
            "    return time.perf_counter() - began\n"
            "print(min(took() for _ in range(7)))\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
        assert float(done.stdout) < 0.005

    def test_plugin_can_be_disabled(self, run_pytest):
        run_pytest(PASSES, "-p", "no:drivecomm").stdout.fnmatch_lines(["*fixture 'virtual_line' not found"])


class TestTheTraceOfAFailingTest:
    def test_failed_test_shows_the_decoded_trace(self, run_pytest):
        result = run_pytest(FAILS)
        result.assert_outcomes(failed=1)
        result.stdout.fnmatch_lines(
            [
                "*- drivecomm: line 1: vabus:1, in virtual time -*",
                "*-> *04 41 30 30 34 38 31 05  enquiry address=1 sys=0 dataset=0 parameter=481",
                "*<- *value address=1 sys=0 dataset=0 parameter=481 data='000003E8'",
            ]
        )

    def test_passed_test_shows_no_trace(self, run_pytest):
        result = run_pytest(PASSES, "-rA")
        result.assert_outcomes(passed=1)
        result.stdout.no_fnmatch_line("*drivecomm: line*")

    def test_failed_test_without_lines_shows_no_trace(self, run_pytest):
        result = run_pytest("def test_a(): assert False")
        result.assert_outcomes(failed=1)
        result.stdout.no_fnmatch_line("*drivecomm:*")

    def test_expected_failure_shows_no_trace(self, run_pytest):
        result = run_pytest("    import pytest\n" + FAILS.replace("def test_a", "@pytest.mark.xfail\n    def test_a"))
        result.assert_outcomes(xfailed=1)
        result.stdout.no_fnmatch_line("*drivecomm: line*")

    def test_trace_has_one_section_per_line(self, run_pytest):
        result = run_pytest("""
            import drivecomm

            def test_a(virtual_line, virtual_drive):
                virtual_line(["vabus:1", "danfoss-fc:3"])
                pump = virtual_drive("fuji:7")
                with drivecomm.open_bus(pump.port) as bus:
                    bus.drive("fuji", 7, model="frenic").read("F07")
                assert False
        """)
        result.stdout.fnmatch_lines(
            [
                "*line 1: vabus:1, danfoss-fc:3, in virtual time*",
                "no traffic on the line",
                "*line 2: fuji:7, in virtual time*",
                "*->*",
            ]
        )

    def test_failed_fixture_shows_the_trace(self, run_pytest):
        result = run_pytest("""
            import pytest, drivecomm

            @pytest.fixture
            def pump(virtual_drive):
                virtual = virtual_drive("vabus:1")
                with drivecomm.open_bus(virtual.port) as bus:
                    bus.drive("vabus", 1).read("999")

            def test_a(pump): pass
        """)
        result.assert_outcomes(errors=1)
        result.stdout.fnmatch_lines(["*drivecomm: line 1: vabus:1*", "*nak address=1*"])

    def test_failed_property_test_shows_the_smallest_example_last(self, run_pytest):
        result = run_pytest(
            """
            import drivecomm
            from hypothesis import HealthCheck, given, settings
            from hypothesis import strategies as st

            unhurried = settings(deadline=None, suppress_health_check=list(HealthCheck))

            @settings(unhurried, max_examples=25, database=None, derandomize=True)
            @given(number=st.integers(90, 110))
            def test_a(virtual_drive, number):
                virtual = virtual_drive("vabus:1")
                with drivecomm.open_bus(virtual.port) as bus:
                    bus.drive("vabus", 1, model="agile").write("481", number)
                    assert number < 100
            """
        )
        result.assert_outcomes(failed=1)
        text = result.stdout.str()
        assert text.count("drivecomm: line") == 8
        # 100 Hz is sent as 10000, which is 2710 in hexadecimal.
        assert "data='00002710'" in text.rpartition("drivecomm: line")[2]


class TestSeed:
    TEST = """
        import drivecomm

        def test_a(virtual_line):
            line = virtual_line(["vabus:1"], faults=0.5)
            other = virtual_line(["vabus:1"], faults=0.5)
            assert other.faults.seed == line.faults.seed + 1
            with drivecomm.open_bus(line.port) as bus:
                drive = bus.drive("vabus", 1, model="agile")
                for _ in range(30):
                    try:
                        drive.read("481")
                    except drivecomm.DriveCommError:
                        pass
            assert False, sorted((fault.value, count) for fault, count in line.faults.happened.items())
    """

    def happened(self, result):
        return next(line for line in result.stdout.lines if line.startswith("E  "))

    def test_seed_is_printed_with_the_faults_that_occurred(self, run_pytest):
        run_pytest(self.TEST).stdout.fnmatch_lines(
            ["faults: rate 0.5, seed 0; the same again with --drivecomm-seed=0; happened: *drop *"]
        )

    @pytest.mark.soak
    def test_same_seed_repeats_the_faults(self, run_pytest):
        first, again, other = (run_pytest(self.TEST, f"--drivecomm-seed={seed}") for seed in (5, 5, 6))
        first.stdout.fnmatch_lines(["faults: rate 0.5, seed 5; the same again with --drivecomm-seed=5; *"])
        assert self.happened(first) == self.happened(again) != self.happened(other)

    def test_fault_plan_of_the_test_keeps_its_seed(self, run_pytest):
        result = run_pytest("""
            from drivecomm.plant import FaultPlan

            def test_a(virtual_line):
                virtual_line(["vabus:1"], faults=FaultPlan(rate=0.1, seed=99))
                assert False
        """)
        result.stdout.fnmatch_lines(["faults: rate 0.1, seed 99; happened: none yet"])

    def test_seed_option_must_be_a_number(self, run_pytest):
        result = run_pytest("def test_a(): pass", "--drivecomm-seed=x")
        result.stderr.fnmatch_lines(["*--drivecomm-seed: invalid int value: 'x'"])


class TestNothingIsLeft:
    @pytest.mark.soak
    @needs_pty
    @pytest.mark.parametrize("end", ["pass", "assert False"])
    def test_no_threads_files_or_links_are_left_after_a_test(self, run_pytest, end):
        threads = threading.active_count()
        descriptors = Path("/proc/self/fd")
        before = len(list(descriptors.iterdir())) if descriptors.exists() else 0
        result = run_pytest(f"""
            import pathlib, threading, drivecomm

            def test_a(virtual_drive, virtual_line):
                ports = [virtual_drive("vabus:1", listen=listen).port for listen in ("pty", "tcp", "rfc2217")]
                assert len([thread for thread in threading.enumerate() if "drivecomm" in thread.name]) == 3
                with drivecomm.open_bus(ports[0]) as bus:
                    bus.drive("vabus", 1).read("481")
                pathlib.Path("path").write_text(ports[0])
                {end}
        """)
        result.assert_outcomes(**({"passed": 1} if end == "pass" else {"failed": 1}))
        assert threading.active_count() == threads
        assert (len(list(descriptors.iterdir())) if descriptors.exists() else 0) == before
        assert not os.path.lexists(Path("path").read_text())

    def test_failed_serving_thread_fails_the_test(self, run_pytest):
        result = run_pytest("""
            import socket, pytest

            def test_a(virtual_drive, monkeypatch):
                drive = virtual_drive("vabus:1", listen="tcp")
                monkeypatch.setattr(drive._drive.inner, "hear", lambda find, now: 1 / 0)
                host, _, port = drive.port.removeprefix("socket://").partition(":")
                with socket.create_connection((host, int(port))) as master:
                    master.sendall(bytes.fromhex("04 41 30 30 34 38 31 05"))
                    with pytest.raises(RuntimeError, match="is no longer served: ZeroDivisionError"):
                        drive.assert_holds("481", 7)
        """)
        result.assert_outcomes(passed=1, errors=1)
        result.stdout.fnmatch_lines(["*ZeroDivisionError*"])

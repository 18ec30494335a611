"""Judgement of a benchmark run: promises kept or not, void figures on a disturbed machine, and the exit code."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the emulated lines need Linux")


@pytest.fixture(scope="module")
def modules():
    """Import the benchmark modules as in a real run, and remove them afterwards."""
    before = dict(sys.modules)
    # Other program folders contain a module `run` as well.
    sys.modules.pop("run", None)
    sys.path.insert(0, str(BENCHMARKS))
    try:
        names = ("run", "report", "lines", "goals", "cores", "compiling")
        yield SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(str(BENCHMARKS))
        for name, module in list(sys.modules.items()):
            if str(getattr(module, "__file__", "")).startswith(str(BENCHMARKS)):
                del sys.modules[name]
        if "run" in before:
            sys.modules["run"] = before["run"]


@pytest.fixture
def run(modules):
    return modules.run


@pytest.fixture
def report(modules):
    return modules.report


@pytest.fixture
def lines(modules):
    return modules.lines


@pytest.fixture
def goals(modules):
    return modules.goals


def figure(report, value, *, name="share", disturbed=False, **more):
    return report.Figure(name=name, value=value, promise=0.9, floor=0.8, disturbed=disturbed, **more)


def section(report, *figures, **more):
    return report.Section(title="one", about="", head=(), figures=list(figures), **more)


@pytest.mark.parametrize(
    ("value", "disturbed", "verdict"),
    [
        (0.95, False, "kept"),
        (0.85, False, "not kept"),
        (0.75, False, "**floor broken**"),
        (0.95, True, "void"),
        (0.75, True, "void"),
    ],
)
def test_disturbed_figure_is_void_whatever_its_value(report, value, disturbed, verdict):
    assert figure(report, value, disturbed=disturbed).verdict == verdict


@pytest.mark.parametrize(
    ("values", "strict", "code"),
    [
        ([(0.95, False)], False, 0),
        ([(0.85, False)], False, 0),
        ([(0.85, False)], True, 1),
        ([(0.75, False)], False, 1),
        ([(0.75, True)], False, 3),
        ([(0.75, True), (0.75, False)], False, 1),
    ],
)
def test_only_undisturbed_figures_can_fail_a_run(modules, values, strict, code, capsys):
    figures = [figure(modules.report, value, disturbed=disturbed) for value, disturbed in values]
    assert modules.run._judged([section(modules.report, *figures)], figures, [], strict=strict) == code
    assert ("void" in capsys.readouterr().err) == any(disturbed for _, disturbed in values)


def test_failed_or_void_section_gives_a_nonzero_exit_code(run, report):
    assert run._judged([section(report, failed=True, remarks=["wrong reply"])], [], [], strict=False) == 1
    assert run._judged([section(report, void=True)], [], [], strict=False) == 3


def test_goal_without_an_undisturbed_figure_is_named(run, report, goals, capsys):
    sound = figure(report, 0.95, name="share of ideal, poll plan, 64 lines, 115200")
    void = figure(report, 0.95, name="share of 50 lines' possible", disturbed=True)
    missing = goals.unjudged([sound, void])
    assert "the same, share of the ideal rate" not in missing
    assert "500 drives on 50 lines, exchanges of those possible" in missing
    assert "blocking read with the reply ready, in yardsticks" in missing
    assert len(missing) == len(goals.GOALS) - 1
    assert run._judged([], [sound], missing, strict=False) == 3
    assert "blocking read with the reply ready" in capsys.readouterr().err


def test_goal_row_shows_its_range_and_worst_verdict(report, goals):
    names = {"vabus, 2 ms": 0.95, "danfoss-fc, 1.1 ms": 0.75, "fuji, 0 ms": 0.5, "vlt3500, 10 ms": 0.9}
    figures = [figure(report, value, name=f"blocking share of ideal, {name}, 19200") for name, value in names.items()]
    (row,) = (line for line in goals.goals(figures).splitlines() if line.startswith("| one line"))
    assert row.startswith("| one line, blocking, share of the wire with pauses, 19200 |")
    assert "| 0.75-0.95 | **floor broken** |" in row


def equipment(spare_s=10.0, others=0.0):
    """Return equipment on a machine where other programs use this share of a core."""
    clock = iter(range(1000))
    master = SimpleNamespace(others_s=lambda: others * next(clock) * 1000)
    return SimpleNamespace(instrument=SimpleNamespace(spare_s=spare_s), master=master)


def test_void_section_is_repeated_once_if_time_is_left(run, report, monkeypatch):
    tried = []

    def measure(_):
        tried.append(1)
        return [section(report, figure(report, 0.95, disturbed=len(tried) == 1))]

    monkeypatch.setattr(run, "import_module", lambda _: SimpleNamespace(measure=measure))
    monkeypatch.setattr(run, "yardstick_us", lambda: 1.0)
    (one,) = run._measure(["scale"], equipment())
    assert (len(tried), one.voids) == (2, 0)
    tried.clear()
    (one,) = run._measure(["scale"], equipment(spare_s=0.0))
    assert (len(tried), one.voids) == (1, 1)


def test_busy_machine_or_changed_clock_makes_all_but_exact_figures_void(run, report, monkeypatch):
    figures = figure(report, 0.95), figure(report, 0.95, exact=True)
    measurement = SimpleNamespace(measure=lambda _: [section(report, *figures)])
    monkeypatch.setattr(run, "import_module", lambda _: measurement)
    monkeypatch.setattr(run, "yardstick_us", lambda: 1.0)
    (one,) = run._sections("scale", equipment(others=1.0))
    assert [each.disturbed for each in one.figures] == [True, False]
    yardsticks = iter([1.0, 2.0])
    monkeypatch.setattr(run, "yardstick_us", lambda: next(yardsticks))
    (one,) = run._sections("scale", equipment())
    assert [each.disturbed for each in one.figures] == [True, False]


class Emulator:
    """Replacement of the emulator that reports the given lateness for each run."""

    late_us = iter(())

    def __init__(self, *_):
        self.paths = []
        self.report = {}

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.report = {"lateness_us": {"p50": 1.0, "p99": next(type(self).late_us)}, "lines": []}


@pytest.mark.parametrize(
    ("late_us", "runs", "disturbed"),
    [([20.0], 1, False), ([500.0, 20.0], 2, False), ([500.0, 300.0, 400.0], 3, True)],
)
def test_disturbed_run_is_repeated_and_the_best_counts(lines, monkeypatch, late_us, runs, disturbed):
    monkeypatch.setattr(lines, "Emulator", Emulator)
    Emulator.late_us = iter(late_us)
    instrument = lines.Instrument(Path("emulator"), equipment().master, tries=3, spare_s=10.0)
    done = []
    run = instrument.measure([], done.append)
    assert (len(done), run.disturbed, run.late_us) == (runs, disturbed, min(late_us))


def test_error_in_a_disturbed_run_is_void_and_in_a_quiet_run_raised(lines, monkeypatch):
    def work(_):
        raise lines.MeasurementError("no reply")

    monkeypatch.setattr(lines, "Emulator", Emulator)
    instrument = lines.Instrument(Path("emulator"), equipment().master, tries=2, spare_s=10.0)
    Emulator.late_us = iter([500.0, 500.0])
    with pytest.raises(lines.DisturbedError, match="no reply"):
        instrument.measure([], work)
    Emulator.late_us = iter([500.0, 20.0])
    with pytest.raises(lines.MeasurementError, match="no reply") as raised:
        instrument.measure([], work)
    assert not isinstance(raised.value, lines.DisturbedError)


def test_disturbed_run_is_not_repeated_without_spare_time(lines, monkeypatch):
    monkeypatch.setattr(lines, "Emulator", Emulator)
    Emulator.late_us = iter([500.0, 20.0])
    instrument = lines.Instrument(Path("emulator"), equipment().master, tries=3, spare_s=0.0)
    assert instrument.measure([], lambda _: None).disturbed


def test_others_s_excludes_this_process_and_its_children(modules):
    before = modules.cores.others_s(1)
    assert before > 0
    assert modules.cores.others_s(1) >= before - 0.1


def test_every_measurement_can_be_imported(modules):
    for name in modules.run.MEASUREMENTS:
        assert callable(importlib.import_module(name).measure)


def test_missing_library_is_named_before_anything_is_measured(modules, tmp_path, monkeypatch):
    monkeypatch.setattr(modules.compiling, "find_spec", lambda name: None if name == "asyncua" else object())
    with pytest.raises(modules.compiling.CannotMeasureError, match=r"asyncua not installed; .*make bench"):
        modules.compiling.compile_programs(tmp_path)

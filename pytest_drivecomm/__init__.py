"""pytest plug-in: fixtures with virtual drives, and the decoded trace of their lines below a failed test.

pytest imports this module at the start of every run of every project in whose environment drivecomm is installed. So it
imports nothing of drivecomm, not even the package: that happens when a test requests one of the fixtures.

    virtual_line    makes a line with virtual drives on it: WatchedLine
    virtual_drive   makes a line with one virtual drive on it: WatchedDrive
    virtual_plant   makes the lines and drives of a plant file: WatchedPlant
    served_plant    makes them in real time, with a server like `drivecomm serve`: WatchedServer

Everything that they make is closed at the end of the test. `drivecomm.testing.fixtures` describes their arguments.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Mapping, Sequence

    from drivecomm.judge import JudgeCase
    from drivecomm.testing import LineMaker, MakesDrive, MakesLine, MakesPlant, MakesServer

__all__ = ["master_tests"]

_LINES = pytest.StashKey["LineMaker"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --drivecomm-seed."""
    parser.getgroup("drivecomm", "drivecomm: virtual drives").addoption(
        "--drivecomm-seed",
        type=int,
        default=0,
        metavar="N",
        help="Seed of the faults on virtual lines. Default: 0.",
    )


@pytest.fixture
def _virtual_lines(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Generator[LineMaker, None, None]:
    from drivecomm.testing import LineMaker

    seed: int = request.config.getoption("--drivecomm-seed")
    with LineMaker(seed, folder=lambda: tmp_path_factory.mktemp("line")) as lines:
        request.node.stash[_LINES] = lines
        yield lines


@pytest.fixture
def virtual_line(_virtual_lines: LineMaker) -> MakesLine:
    """Make a line: `virtual_line(["vabus:1", "danfoss-fc:3"], listen=None, faults=0.0, echo=False, paced=False)`."""
    return _virtual_lines.line


@pytest.fixture
def virtual_drive(_virtual_lines: LineMaker) -> MakesDrive:
    """Make a drive on a line of its own: `virtual_drive("vabus:1", listen="pty", model=..., own options)`."""
    return _virtual_lines.drive


@pytest.fixture
def virtual_plant(_virtual_lines: LineMaker) -> MakesPlant:
    """Make a plant: `virtual_plant("plant.toml", listen=None)`."""
    return _virtual_lines.plant


@pytest.fixture
def served_plant(_virtual_lines: LineMaker) -> MakesServer:
    """Make a plant and serve it: `served_plant("plant.toml")` has `url`, `socket`, `plant` and `client`."""
    return _virtual_lines.server


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Attach the traces of the virtual lines of a failed test, and the seed of their faults."""
    report = yield
    if report.failed and (lines := item.stash.get(_LINES, None)) is not None:
        traces = list(lines.traces())
        report.sections.extend((f"drivecomm: {title}", text) for title, text in traces)
        # JUnit XML shows the properties of a test, but no sections apart from captured output.
        told = [("drivecomm-seed", str(lines.seed))]
        told += [("drivecomm-trace", f"{title}\n{text}") for title, text in traces]
        item.user_properties += [each for each in told if each not in item.user_properties]
    return report


def master_tests(
    drive: str, *, command: Sequence[str], tasks: Mapping[str, str], **order: Any
) -> Callable[[pytest.FixtureRequest, JudgeCase], None]:
    """Return a test function that plays every case of `drivecomm judge` as a separate test.

        test_driver = master_tests("vabus:1", command=["./mydriver", "{port}"], tasks={"read": "read 481"})

    drive: PROTOCOL:ADDRESS with options, or a protocol. tasks: the arguments of each task, as a shell would take them.
    order: further fields of `drivecomm.judge.JudgeOrder`. Raises UsageError for an invalid order.
    """
    from drivecomm.judge import Judge, JudgeOrder, parse_task
    from drivecomm.protocol import installed, parse_drive

    named = drive if ":" in drive else f"{drive}:{installed[drive].addresses[0]}"
    told = tuple(parse_task(f"{name}={arguments}") for name, arguments in tasks.items())
    judge = Judge(JudgeOrder(drive=parse_drive(named), command=tuple(command), tasks=told, **order))

    @pytest.mark.parametrize("case", judge.cases, ids=[case.name for case in judge.cases])
    def test_master(request: pytest.FixtureRequest, case: JudgeCase) -> None:
        verdict = judge.verdict(case)
        request.node.user_properties.append(("drivecomm-seed", str(verdict.seed)))
        if verdict.outcome == "not tried":
            pytest.skip(verdict.reason)
        if verdict.outcome == "failed":
            request.node.add_report_section("call", "drivecomm: the master printed", "\n".join(verdict.output))
            request.node.add_report_section("call", "drivecomm: telegrams", "\n".join(verdict.trace))
            pytest.fail(f"{verdict.title}: {verdict.reason}", pytrace=False)

    return test_master

"""Conformance report: order, page, and pytest tests."""

import os
import subprocess
import sys
from html.parser import HTMLParser

import pytest

from drivecomm.protocol import installed
from drivecomm.testing import QUICK, Check, CheckFailure, carry_out, page, run_conformance, sections_of, try_out

VABUS = installed["vabus"]


def fail():
    raise CheckFailure("<b>7 & 8</b> are not alike")


MIXED = carry_out(
    [
        Check("vabus/contract/one", lambda: None, "One holds."),
        Check("vabus/file/a/two", lambda: None, "Two holds."),
        Check("vabus/file/b/two", fail, "Two holds."),
        Check("vabus/file/c/two", lambda: None, "Two holds as well."),
    ]
)


def test_sections_group_results_by_theme_and_kind():
    contract, file = sections_of(MIXED)
    assert (contract.title, contract.number, contract.failed) == ("contract", 1, 0)
    assert (file.title, file.number, file.failed) == ("file", 3, 1)
    assert [(row.kind, row.meaning, row.number, len(row.failed)) for row in file.rows] == [
        ("two", "Two holds.", 2, 1),
        ("two", "Two holds as well.", 1, 0),
    ]


def test_duration_of_a_check_is_measured():
    verdict = try_out(Check("a/b", lambda: sum(range(100_000))))
    assert verdict.passed
    assert verdict.seconds > 0
    assert MIXED.seconds == sum(each.seconds for each in MIXED.results)


def test_failure_without_a_reason_counts_as_a_failure():
    def fail_silently():
        raise CheckFailure

    assert not try_out(Check("a/b", fail_silently)).passed


class Page(HTMLParser):
    """Strict HTML parser: every element must be closed in order."""

    VOID = frozenset(["meta", "br"])

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.seen = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.seen.append((tag, dict(attributes)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_page_needs_no_external_parts():
    read = Page(page(VABUS, MIXED))
    assert read.open == []
    tags = [tag for tag, _ in read.seen]
    assert not {"script", "link", "img", "iframe"} & set(tags)
    assert not any("src" in attributes or "href" in attributes for _, attributes in read.seen)
    assert ("meta", {"name": "viewport", "content": "width=device-width, initial-scale=1"}) in read.seen


def test_page_shows_failures_with_escaped_reasons():
    read = Page(page(VABUS, MIXED))
    assert "1 of 4 checks do not hold" in read.text
    assert "<b>7 & 8</b> are not alike" in read.text
    assert "vabus/file/b/two" in read.text
    assert VABUS.title in read.text


def test_page_of_a_passing_protocol_lists_all_checks():
    report = run_conformance(VABUS, QUICK, only="/contract/")
    read = Page(page(VABUS, report))
    assert f"all {len(report.passed)} checks hold" in read.text
    assert all(verdict.check.meaning in read.text for verdict in report.results)


THREE_LINES = """
from drivecomm.testing import conformance_tests

test_conformance = conformance_tests("vabus"{extent})
"""


@pytest.fixture
def pytest_in(tmp_path):
    def run(text, *arguments):
        (tmp_path / "test_toy.py").write_text(text, encoding="utf-8")
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_toy.py", *arguments]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=120
        )

    return run


@pytest.mark.soak
def test_conformance_tests_of_three_lines_run_in_pytest(pytest_in):
    done = pytest_in(THREE_LINES.format(extent=""), "-k", "contract or documents", "-vv")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "test_conformance[vabus/contract/has all fields] PASSED" in done.stdout
    assert "22 passed" in done.stdout


@pytest.mark.soak
def test_failed_conformance_test_shows_its_reason(pytest_in):
    broken = """
from dataclasses import replace
from drivecomm.testing import QUICK
from drivecomm.protocol import installed
installed._loaded["vabus"] = replace(installed["vabus"], facts_source="?")
""" + THREE_LINES.format(extent=", QUICK")
    done = pytest_in(broken, "-k", "documents")
    assert done.returncode == 1
    assert "the source of the line facts is '?'" in done.stdout
    assert "1 failed, 6 passed" in done.stdout


def test_repeated_error_outside_the_tree_is_printed_once_with_its_place():
    def failing():
        raise KeyError("n")

    report = carry_out([Check(f"toy/x/{number}", failing) for number in range(21)])
    lines = str(report).splitlines()
    line = failing.__code__.co_firstlineno + 1
    assert lines[1] == f"toy/x/0: KeyError outside the error tree: 'n' ({__file__}:{line})"
    assert lines[2:] == [f"toy/x/{number}: as toy/x/0" for number in range(1, 21)]

"""JUnit XML report of a run for continuous integration: one test case for each case."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

if TYPE_CHECKING:
    from drivecomm.judge.report import JudgeReport
    from drivecomm.judge.verdicts import Verdict

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML does not allow."""


def junit(report: JudgeReport) -> str:
    """Return a report as JUnit XML, with the seed as a property, and the telegrams as the output of each case."""
    counts = report.counts
    numbers = {
        "tests": str(len(report.verdicts)),
        "failures": str(counts["failed"]),
        "errors": "0",
        "skipped": str(counts["not tried"]),
        "time": f"{report.seconds:.3f}",
    }
    suites = Element("testsuites", numbers)
    suite = SubElement(suites, "testsuite", {"name": f"drivecomm judge {report.drive}", **numbers})
    properties = SubElement(suite, "properties")
    for name, value in {**report.properties(), "master": report.master}.items():
        SubElement(properties, "property", {"name": name, "value": _clean(value)})
    for covered in report.coverage:
        SubElement(properties, "property", {"name": f"coverage of {covered.what}", "value": str(covered)})
    for verdict in report.verdicts:
        _add(suite, report, verdict)
    indent(suites)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(suites, encoding="unicode") + "\n"


def _add(suite: Element, report: JudgeReport, verdict: Verdict) -> None:
    name = f"drivecomm.judge.{report.drive.replace(':', '-')}.{verdict.case.partition('-')[0]}"
    case = SubElement(suite, "testcase", {"classname": name, "name": verdict.case, "time": f"{verdict.seconds:.3f}"})
    properties = SubElement(case, "properties")
    SubElement(properties, "property", {"name": "seed", "value": str(verdict.seed)})
    reason = _clean(verdict.reason)
    if verdict.outcome == "failed":
        SubElement(case, "failure", {"message": reason, "type": "failed"}).text = f"{verdict.title}\n{reason}"
    elif verdict.outcome == "not tried":
        SubElement(case, "skipped", {"message": reason})
    told = [f"{verdict.outcome}: {verdict.reason}", *verdict.violations, *verdict.trace]
    SubElement(case, "system-out").text = _clean("\n".join(told))
    SubElement(case, "system-err").text = _clean("\n".join(verdict.output))


def _clean(text: str) -> str:
    return _NOT_XML.sub("?", text)

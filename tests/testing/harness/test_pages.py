"""Pages about testing, executed like a reader would: their files written, commands run, and output compared."""

import os
import shlex
import sys

import pytest
from console import must_match
from pages import ROOT, blocks_of

pytest_plugins = ["pytester"]

PAGES = [ROOT / "docs" / "how-to" / name for name in ("test-your-master.md", "test-library-code.md")]
BY_US = "tests/harness/test_pages.py runs it"


@pytest.mark.soak
@pytest.mark.skipif(os.name != "posix", reason="the pages use a pseudo-terminal and a shell")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_on_the_page_print_the_shown_output(page, pytester, plugin_folder, monkeypatch):
    monkeypatch.syspath_prepend(str(plugin_folder))
    monkeypatch.setenv("COLUMNS", "80")
    ran = 0
    for block in blocks_of(page):
        if block.title:
            (pytester.path / block.title).write_text(block.code, encoding="utf-8")
        elif BY_US in block.remark:
            command, _, shown = block.code.partition("\n")
            words = shlex.split(command)
            assert words[:3] == ["$", "python", "-m"], block
            if words[3] == "unittest":
                result = pytester.run(sys.executable, "-W", "error", *words[2:])
                told = result.stderr.str()
            else:
                result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-W", "error", *words[4:])
                told = result.stdout.str()
            must_match(shown, told + "\n", f"{block}: {command}")
            ran += 1
    assert ran

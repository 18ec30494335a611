"""Every runnable code block of the documentation runs, and prints the output that the page shows."""

import contextlib
import io
import re
import tomllib
from pathlib import Path

import pytest
from console import Console, in_process, must_match
from extents import every
from pages import PAGES, blocks_of, name_of, pages_with


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Run in an empty folder, with a terminal wide enough for every line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    # The variable is set first, so that pytest undoes an export by the page afterwards.
    monkeypatch.setenv("DRIVECOMM_PORT", "")
    monkeypatch.delenv("DRIVECOMM_PORT")


def foreign_files(page):
    """Write the files of other programs that a page shows; files for drivecomm have separate tests."""
    for block in blocks_of(page):
        if block.title and block.language in ("csv", "yaml", "log"):
            Path(block.title).write_text(block.code, encoding="utf-8")


@pytest.mark.parametrize("page", pages_with("python"), ids=name_of)
@pytest.mark.usefixtures("elsewhere")
def test_python_blocks_of_the_page_run(page):
    foreign_files(page)
    namespace = {}
    printed = None
    for block in blocks_of(page):
        if block.language == "text" and block.remark == "prints" and printed is not None:
            must_match(block.code, printed, block)
        if block.language != "python" or block.title:
            continue
        # Empty lines in front give a traceback the line numbers of the page.
        code = compile("\n" * block.line + block.code, str(page), "exec")
        printed = None
        if block.is_run:
            if block.remark != "continues":
                namespace = {"__name__": "__main__"}
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(code, namespace)
            printed = output.getvalue()


@pytest.mark.parametrize("page", every(4, pages_with("console")), ids=name_of)
@pytest.mark.usefixtures("elsewhere")
def test_console_blocks_of_the_page_run(page):
    foreign_files(page)
    with Console(in_process) as console:
        for block in blocks_of(page):
            if block.language == "console" and block.is_run:
                console.play(block)


@pytest.mark.parametrize("page", pages_with("toml"), ids=name_of)
def test_toml_blocks_of_the_page_parse(page):
    for block in blocks_of(page):
        if block.language == "toml":
            tomllib.loads(block.code)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_remarks_of_code_blocks_are_known(page):
    for block in blocks_of(page):
        assert re.fullmatch(r"|continues|prints|not run: .+", block.remark), block


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_page_has_one_sentence_per_line(page):
    """With one sentence per line a changed sentence is a changed line in the diff."""
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for line in text.splitlines():
        if not line.startswith(("|", "    ", "#")):
            assert not re.search(r"[a-z)`][.!?] [A-Z]", line), line

"""Every code block of the documentation that can run is run, and prints what the page says."""

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
    """Run in a folder of its own, with a terminal that is wide enough for every line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    # Set first, so that what a page exports is taken back afterwards.
    monkeypatch.setenv("DRIVECOMM_PORT", "")
    monkeypatch.delenv("DRIVECOMM_PORT")


def foreign_files(page):
    """Write what stands on a page as a file of another program; ours have tests of their own."""
    for block in blocks_of(page):
        if block.title and block.language in ("csv", "yaml", "log"):
            Path(block.title).write_text(block.code, encoding="utf-8")


@pytest.mark.parametrize("page", pages_with("python"), ids=name_of)
@pytest.mark.usefixtures("elsewhere")
def test_python(page):
    foreign_files(page)
    namespace = {}
    printed = None
    for block in blocks_of(page):
        if block.language == "text" and block.remark == "prints" and printed is not None:
            must_match(block.code, printed, block)
        if block.language != "python" or block.title:
            continue
        # The line numbers of a traceback are those of the page.
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
def test_console(page):
    foreign_files(page)
    with Console(in_process) as console:
        for block in blocks_of(page):
            if block.language == "console" and block.is_run:
                console.play(block)


@pytest.mark.parametrize("page", pages_with("toml"), ids=name_of)
def test_toml(page):
    for block in blocks_of(page):
        if block.language == "toml":
            tomllib.loads(block.code)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_remarks_are_known(page):
    for block in blocks_of(page):
        assert re.fullmatch(r"|continues|prints|not run: .+", block.remark), block


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_one_sentence_a_line(page):
    """Prose has semantic newlines, so that a change of one sentence is a change of one line."""
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for line in text.splitlines():
        if not line.startswith(("|", "    ", "#")):
            assert not re.search(r"[a-z)`][.!?] [A-Z]", line), line

"""The troubleshooting page quotes messages in the words of the code."""

import re

import pytest
from pages import ROOT, blocks_of

PAGE = ROOT / "docs" / "how-to" / "troubleshooting.md"
TEXT = PAGE.read_text(encoding="utf-8")
# Placeholders on the page for real values: a port, a group, a program, a drive, the bytes of a telegram.
EXAMPLES = re.compile(
    r"drivecomm: |/dev/ttyUSB0|dialout|drivecomm start \(pid \d+\)|hall, pump, 480: |vabus:1|\(value telegram.*?\)(?=;)"
)


def quoted():
    """Yield the messages quoted in tables, sentences and blocks of the page."""
    table = TEXT.partition("\n## The drive answers, but does not start\n")[2].partition("```")[0]
    yield from re.findall(r"^\| `([^`]+)` \|", table, re.MULTILINE)
    yield from re.findall(r"(?:The message is |is refused, )`([^`]+)`", TEXT)
    for block in blocks_of(PAGE):
        if block.language == "text":
            yield EXAMPLES.sub("...", block.code.strip())


@pytest.fixture(scope="module")
def words():
    """Return the code of the framework and the protocols, with messages that span several lines joined."""
    paths = [
        path
        for tree in ("drivecomm", "protocols")
        for path in (ROOT / tree).rglob("*")
        if path.suffix in {".py", ".toml"}
    ]
    code = "\n".join(path.read_text(encoding="utf-8") for path in paths)
    return re.sub(r"\"\s*f?\"", "", code)


@pytest.mark.parametrize("message", list(quoted()))
def test_quoted_message_is_in_the_code(message, words):
    parts = [part.strip(" .;") for part in re.split(r"\.\.\.|[:;] ", message)]
    told = [part for part in parts if len(part) > len("code 76")]
    assert told
    assert [part for part in told if part not in words] == []

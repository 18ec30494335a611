"""The reference of the command line is made from the commands; each says what it is for, and so does each option."""

import pytest
from commands_page import all_commands, commands_page

COMMANDS = dict(all_commands())


def test_a_section_for_each_command():
    page = commands_page()
    for name in COMMANDS:
        assert f"\n## {name} {{ #drivecomm-{name.replace(' ', '-')} }}\n" in page


@pytest.mark.parametrize("name", COMMANDS)
def test_help(name):
    context = COMMANDS[name]
    assert context.command.help
    assert [one.name for one in context.command.params if not getattr(one, "hidden", False) and not one.help] == []


def test_no_paragraph_of_the_page_is_taken_for_code():
    assert "\n    " not in commands_page()


def test_what_a_section_says():
    section = commands_page().partition("\n## write {")[2].partition("\n## ")[0]
    assert "\ndrivecomm write [OPTIONS] DRIVE PARAM VALUE\n" in section
    assert "| `--store` | Store it in EEPROM, so that it survives power-off. |" in section
    assert "\nAll [options of a line](#options-of-a-line).\n" in section
    assert "](../how-to/" in section


def test_options_of_a_line_without_effect_are_named():
    section = commands_page().partition("\n## read {")[2].partition("\n## ")[0]
    assert "\nAll [options of a line](#options-of-a-line), but `--arm`.\n" in section

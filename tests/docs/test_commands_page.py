"""The command line reference is generated from the commands; each command and option has a help text."""

import pytest
from commands_page import all_commands, commands_page

COMMANDS = dict(all_commands())


def test_commands_page_has_a_section_for_each_command():
    page = commands_page()
    for name in COMMANDS:
        assert f"\n## {name} {{ #drivecomm-{name.replace(' ', '-')} }}\n" in page


@pytest.mark.parametrize("name", COMMANDS)
def test_command_and_its_options_have_help_texts(name):
    context = COMMANDS[name]
    assert context.command.help
    assert [one.name for one in context.command.params if not getattr(one, "hidden", False) and not one.help] == []


def test_commands_page_has_no_indented_paragraph():
    assert "\n    " not in commands_page()


def test_section_of_a_command_has_usage_options_and_links():
    section = commands_page().partition("\n## write {")[2].partition("\n## ")[0]
    assert "\ndrivecomm write [OPTIONS] DRIVE PARAM VALUE\n" in section
    assert "| `--store` | Store it in EEPROM, so that it survives power-off. |" in section
    assert "\nAll [options of a line](#options-of-a-line).\n" in section
    assert "](../how-to/" in section


def test_section_names_line_options_without_effect():
    section = commands_page().partition("\n## read {")[2].partition("\n## ")[0]
    assert "\nAll [options of a line](#options-of-a-line), but `--arm`.\n" in section

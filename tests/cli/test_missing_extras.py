"""Commands without their optional libraries: one sentence names the library and how to install it."""

import sys

import pytest


@pytest.fixture
def without(monkeypatch):
    """Return a function that makes a module look uninstalled."""

    def hide(module):
        monkeypatch.setitem(sys.modules, module, None)

    return hide


@pytest.mark.parametrize("module", ["fastapi", "uvicorn"])
def test_serve_names_the_missing_library(shell, without, tmp_path, module):
    plant = tmp_path / "plant.toml"
    plant.write_text('format = 1\n[[line]]\nname = "hall"\nport = "nowhere"\n', encoding="utf-8")
    without(module)
    assert shell("serve", str(plant), port=None) == 2
    assert shell.err == f"drivecomm: a server needs {module}, which is not installed; install drivecomm[server]\n"


@pytest.mark.parametrize(
    ("module", "arguments", "sentence"),
    [
        ("aiomqtt", [], "a fleet needs aiomqtt, which is not installed; install drivecomm[mqtt]"),
        (
            "starlette",
            ["--listen", "127.0.0.1:0"],
            "the page of a fleet needs starlette, which is not installed; install drivecomm[server]",
        ),
    ],
)
def test_fleet_names_the_missing_library(shell, without, module, arguments, sentence):
    without(module)
    assert shell("fleet", "mqtt://127.0.0.1:9", *arguments, port=None) == 2
    assert shell.err == f"drivecomm: {sentence}\n"

"""What all tests share."""

import functools

import pytest


@pytest.fixture(scope="session", autouse=True)
def commands_built_once():
    """Build the tree of commands once: a process that ends after one command builds it once, too."""
    import typer.main  # noqa: PLC0415 - no sooner than a test runs

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", functools.cache(typer.main.get_command))
        yield

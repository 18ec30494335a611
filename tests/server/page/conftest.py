"""A Chromium for the tests of the page, and a fake plant to show."""

import os

import pytest
from page_standin import StandIn

CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
TIMEOUT_MS = 8000


@pytest.fixture(scope="module")  # Playwright's event loop occupies the thread until it ends
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="the page is tested with playwright")
    with playwright.sync_playwright() as started:
        try:
            chromium = started.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS, timeout=30000)
        except playwright.Error as error:
            pytest.skip(f"Chromium does not start: {str(error).splitlines()[0]}")
        yield chromium
        chromium.close()


@pytest.fixture
def launched(browser):
    """Return a function that starts another Chromium, which may be killed, with additional environment variables."""

    def launch(**environment):
        return browser.browser_type.launch(executable_path=CHROMIUM, args=ARGUMENTS, env={**os.environ, **environment})

    return launch


@pytest.fixture
def page_server():
    """Yield a server with a fake plant of three drives, controlled by the test."""
    plant = StandIn()
    plant.start()
    yield plant
    plant.stop()


@pytest.fixture
def watched(browser):
    """Return a function that opens a page of a server; the test fails if the page reports an error meanwhile."""
    contexts, wrong = [], []

    def opened(url, place="", **context):
        contexts.append(browser.new_context(**context))
        page = contexts[-1].new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda message: "Content Security" in message.text and wrong.append(message.text))
        page.on("request", lambda request: request.url.startswith(url) or wrong.append(request.url))
        page.goto(url + place, wait_until="domcontentloaded", timeout=TIMEOUT_MS)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert wrong == []


@pytest.fixture
def shown(watched, page_server):
    """Return a function that opens the page of the server."""

    def opened(place="", *, live=True, **context):
        page = watched(page_server.url, place, **context)
        if live:
            page.wait_for_selector("html[data-link=live]")
        return page

    return opened

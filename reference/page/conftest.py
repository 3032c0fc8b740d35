"""Where the page is, and the browser that it is opened in."""

from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright


def pytest_addoption(parser):
    parser.addoption("--page", required=True, help="index.html of a report of two scenes")
    parser.addoption("--chromium", default="/usr/bin/chromium", help="the browser's program")
    parser.addoption("--pictures", help="folder for pictures of the page, to look at")


@pytest.fixture(scope="session")
def address(request):
    return Path(request.config.getoption("--page")).resolve().as_uri()


@pytest.fixture(scope="session")
def start(request):
    """Starts a browser; how it draws is given by arguments of its own."""
    program = request.config.getoption("--chromium")
    with sync_playwright() as playwright:
        browsers = []

        def begin(*arguments):
            browsers.append(playwright.chromium.launch(executable_path=program, args=["--no-sandbox", *arguments]))
            return browsers[-1]

        yield begin
        for browser in browsers:
            browser.close()


@pytest.fixture(scope="session")
def browser(start):
    """WebGL without a graphics card."""
    return start("--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture(scope="session")
def pictures(request):
    folder = request.config.getoption("--pictures")
    if folder is None:
        return None
    Path(folder).mkdir(parents=True, exist_ok=True)
    return Path(folder)

"""A real Chromium for tests of the page at the tank: touched and held down as a finger does, by Playwright."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING, Any

import pytest

from support.browser import CHROMIUM

if TYPE_CHECKING:
    from collections.abc import Iterator

PATIENCE_MS = 180_000
"""For each wait: a simulator that was never started compiles for a minute on a busy machine."""
PHONE: dict[str, Any] = {
    "viewport": {"width": 390, "height": 844},
    "device_scale_factor": 2,
    "has_touch": True,
    "is_mobile": True,
}
DESKTOP: dict[str, Any] = {"viewport": {"width": 1280, "height": 900}, "device_scale_factor": 1}


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """Yield a browser; the test is skipped where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="pip install -r requirements/browser.txt")
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with playwright.sync_playwright() as started:
        # The sandbox cannot be had by root; what is opened here is our own page.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = started.chromium.launch(executable_path=CHROMIUM, args=arguments)
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def opened(browser: Any, address: str, device: dict[str, Any], **more: Any) -> Iterator[Any]:
    """Yield a page on a device of its own; an error of its script fails the test."""
    context = browser.new_context(**device, **more)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    try:
        yield page
    finally:
        context.close()
    assert errors == []


def wait_for_text(page: Any, selector: str, text: str) -> None:
    """Wait until an element's text has this in it."""
    page.wait_for_function(
        "([selector, text]) => document.querySelector(selector)?.textContent.includes(text)", arg=[selector, text]
    )

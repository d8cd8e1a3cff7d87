"""The page at the tank in a real browser: a phone held upright, and a desktop, before real nodes.

    PAGE_PICTURES=docs/figures python -m pytest -m long tests/graph/test_page_browser.py

also writes the pictures of the documents.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from support.network import network
from support.page_browser import DESKTOP, PHONE, chromium, opened, wait_for_text
from support.page_client import address_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.long
HELD_MS = 1500
"""For a button that is held down for 800 ms."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


def picture(page: Any, name: str) -> None:
    """Write a picture into the documents' folder, where it is asked for."""
    if folder := os.environ.get("PAGE_PICTURES"):
        page.screenshot(path=Path(folder) / f"{name}.png")


def press(page: Any, action: str, *, hold: bool = False) -> None:
    """Press a button once it may be pressed; again where the step was put on the screen anew meanwhile."""
    button = page.locator(f"button[data-action={action}]")
    key = button.get_attribute("data-key")
    page.locator(f"button[data-action={action}]:enabled").wait_for()
    button.click(delay=HELD_MS if hold else 50)
    gone = "(key) => !document.querySelector(`button[data-key='${key}']`)"
    page.wait_for_function(gone, arg=key)


def start_page(start: Start, *arguments: str) -> tuple[StartedProcess, str]:
    page = start("fin_bringup", "page", "--port", "0", *arguments)
    return page, address_of(page)


def test_a_study_is_watched_on_a_phone_and_a_desktop_at_once(start: Start, tmp_path: Path, browser: Any) -> None:
    words = (f"study_folder:={tmp_path / 'study'}", "disk.minimum_free:=0", "trials:=200", "seed:=3", "speed:=4.0")
    start("fin_bringup", "bringup", *words)
    _, address = start_page(start)
    with opened(browser, address, PHONE) as phone, opened(browser, address, DESKTOP) as desktop:
        for page in (phone, desktop):
            page.wait_for_selector("body[data-lost=false]")
            wait_for_text(page, "#pages", "also open at 127.0.0.1")
        phone.wait_for_function("() => /best \\d/.test(document.querySelector('#study-text').textContent)")
        phone.wait_for_function("() => Number(document.querySelector('#settled').value) >= 4")
        wait_for_text(phone, "#state", "SWIMMING")
        phone.wait_for_function("() => Number(document.querySelector('#speed').textContent) > 0.5")
        width = phone.evaluate("document.documentElement.scrollWidth")
        assert width <= PHONE["viewport"]["width"], "the phone's page scrolls sideways"
        picture(phone, "page_phone")
        picture(desktop, "page_desktop")
        press(desktop, "pause")
        wait_for_text(phone, "#events", "pressed: Pause after this trial")
        phone.locator("#stop").tap()
        wait_for_text(phone, "#stop-text", "heard by /fish/simulator")
        assert re.search(r"after \d+\.\d ms, at .*on this screen \d+ ms after", phone.inner_text("#stop-text"))
        wait_for_text(desktop, "#state", "FAULT")
        wait_for_text(desktop, "#stop-text", "pressed at 127.0.0.1")
        press(desktop, "release", hold=True)
        wait_for_text(phone, "#state", "READY")


def test_a_robot_in_a_rehearsal_is_confirmed_stopped_and_released_on_a_phone(
    start: Start, tmp_path: Path, browser: Any
) -> None:
    words = (f"study_folder:={tmp_path / 'study'}", "disk.minimum_free:=0", "trials:=3", "operator.acts:=false")
    start("fin_bringup", "bringup", "plant:=rehearsal", *words)
    _, address = start_page(start)
    with opened(browser, address, PHONE) as phone:
        # Refused as long as the driver has not been told of the emulated device.
        while "Mount this fin" not in phone.inner_text("#advice"):
            button = phone.locator("button[data-action=configure]:enabled")
            if button.count():
                button.click()
            phone.wait_for_timeout(200)
        wait_for_text(phone, "#mount", "mm")
        phone.locator("button[data-action=confirm_fin]:enabled").wait_for()
        picture(phone, "page_phone_fin")
        press(phone, "confirm_fin")
        wait_for_text(phone, "#advice", "Hands off the tail")
        phone.locator("button[data-action=activate]:enabled").wait_for()
        phone.locator("button[data-action=activate]").click(delay=50)  # a touch is not enough to arm
        press(phone, "activate", hold=True)
        press(phone, "confirm_mark")
        wait_for_text(phone, "#state", "SWIMMING")
        phone.wait_for_function("() => Number(document.querySelector('#speed').textContent) > 0.5")
        phone.locator("#stop").tap()
        wait_for_text(phone, "#stop-text", "heard by /fish/servo_driver")
        wait_for_text(phone, "#state", "FAULT")
        picture(phone, "page_phone_stop")
        press(phone, "release", hold=True)
        wait_for_text(phone, "#advice", "Bring the fish back to its mark")
    log = (tmp_path / "study" / "page.log").read_text()
    assert log.count("pressed: ARM") == 1
    assert "EMERGENCY STOP" in log


def test_what_is_lost_is_said_within_a_second_and_comes_back(start: Start, tmp_path: Path, browser: Any) -> None:
    start("fin_sim", "simulator", "--ros-args", "-r", "__ns:=/fish")
    server, address = start_page(start)
    with opened(browser, address, PHONE) as phone:
        phone.wait_for_selector("body[data-lost=false]")
        wait_for_text(phone, "#state", "READY")
        # When the last word came, and when the page said that it was lost, by the page's own clock.
        phone.evaluate(
            """() => {
                window.lostAt = null;
                new MutationObserver(() => {
                    if (document.body.dataset.lost === "true") window.lostAt ??= performance.now();
                }).observe(document.body, { attributes: true });
            }"""
        )
        phone.context.set_offline(True)
        server.kill()
        began = phone.evaluate("performance.now()")
        phone.wait_for_selector("body[data-lost=true]")
        assert phone.evaluate("window.lostAt") - began < 1000
        wait_for_text(phone, "#lost-text", "use the switch of its servos")
        assert phone.locator(".buttons button").count() == 0
        picture(phone, "page_phone_lost")
        phone.locator("#stop").tap()
        wait_for_text(phone, "#stop-text", "USE THE SWITCH OF THE SERVOS")
        phone.context.set_offline(False)
        start("fin_bringup", "page", "--port", address.rpartition(":")[2])
        phone.wait_for_selector("body[data-lost=false]")  # loaded anew, since its server is another one
        # What was pressed without a connection is sent now.
        wait_for_text(phone, "#state", "FAULT")
        wait_for_text(phone, "#stop-text", "heard by /fish/simulator")


def test_without_a_network_a_stop_is_sent_late_and_a_start_never(start: Start, tmp_path: Path, browser: Any) -> None:
    words = (f"study_folder:={tmp_path / 'study'}", "disk.minimum_free:=0", "trials:=2000", "speed:=4.0")
    start("fin_bringup", "bringup", *words)
    _, address = start_page(start)
    with network(int(address.rpartition(":")[2])) as between:
        there = address.replace(address.rpartition(":")[2], str(between.port))
        with opened(browser, there, PHONE) as phone, opened(browser, address, DESKTOP) as desktop:
            wait_for_text(phone, "#state", "SWIMMING")
            press(phone, "pause")
            phone.locator("button[data-action=start]:enabled").wait_for()
            between.die()
            # At once, while the page does not know yet that nobody hears it; and again when it knows.
            phone.evaluate(
                "() => { window.before = document.querySelector('button[data-action=start]'); before.click(); }"
            )
            phone.wait_for_selector("body[data-lost=true]")
            phone.evaluate("() => before.click()")
            phone.locator("#stop").tap()
            wait_for_text(phone, "#stop-text", "no connection: USE THE SWITCH OF THE SERVOS. It is sent when")
            desktop.wait_for_function(
                "() => document.getElementById('pages').textContent === ''"
            )  # the server gave it up
            between.revive()
            phone.wait_for_selector("body[data-lost=false]")
            wait_for_text(phone, "#stop-text", "SENT LATE, ")
            wait_for_text(phone, "#state", "FAULT")
            phone.locator("button[data-action=start]:enabled").wait_for()  # still paused
    deeds = [line.split("\t")[2] for line in (tmp_path / "study" / "page.log").read_text().splitlines()]
    pressed = [deed for deed in deeds if deed.startswith("pressed")]
    assert pressed[0] == "pressed: Pause after this trial"
    assert re.fullmatch(r"pressed: EMERGENCY STOP, \d+ s ago without a connection", pressed[1])
    assert len(pressed) == 2


def test_a_wrong_token_shows_nothing_and_a_foreign_page_reaches_nothing(start: Start, browser: Any) -> None:
    _, address = start_page(start, "--host", "0.0.0.0")  # noqa: S104
    base, _, _ = address.partition("/?token=")
    with opened(browser, f"{base}/?token=wrong", PHONE) as phone:
        assert "its token is wrong" in phone.inner_text("body")
        assert phone.locator("#stop").count() == 0
    with opened(browser, address, PHONE) as phone:
        phone.wait_for_selector("#stop")
        wait_for_text(phone, "#lost-text", "Nothing is heard")
        assert "token" not in phone.url
        assert phone.evaluate("document.cookie") == ""
        phone.goto("data:text/html,<title>foreign</title>")
        opened_socket = """(address) => new Promise((settle) => {
            const socket = new WebSocket(address);
            socket.onopen = () => settle(true);
            socket.onerror = () => settle(false);
        })"""
        assert phone.evaluate(opened_socket, base.replace("http", "ws") + "/socket") is False
        phone.goto(base)  # the cookie is still there
        phone.wait_for_selector("#stop")

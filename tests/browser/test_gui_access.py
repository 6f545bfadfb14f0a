"""A page that listens elsewhere than on loopback: whoever has no token sees, whoever brings or types one orders."""

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from processes import poll

sys.path.insert(0, str(Path(__file__).parent))

from gui_stage import Stage

pytestmark = pytest.mark.usefixtures("chromium")
OPERATE, VIEW = "may/operate+=", "may-view"
OpenPage = Callable[..., Page]


def guarded(stage: Stage, name: str, **tokens: str) -> str:
    """The address of a page on all addresses of this machine with these tokens."""
    own = {f"SENSE4HRI_{key.upper()}_TOKEN": token for key, token in tokens.items()}
    return replace(stage, environment=stage.environment | own).gui(name=name, host="0.0.0.0")[1]


def mark(page: Page) -> str:
    """What the page says of a marker once the server has answered."""
    said = page.locator("#marker-said")

    def answered() -> str:
        page.keyboard.press("s")
        page.wait_for_timeout(100)
        text = said.text_content() or ""
        return text if "±" in text or "token" in text else ""

    return str(poll(answered, "an answer to a marker"))


def test_the_address_may_bring_the_token(stage: Stage, new_page: OpenPage) -> None:
    """Before, orders are refused with the reason; then carried out. Neither address nor scripts hold the token."""
    address = guarded(stage, "brought", operate=OPERATE)
    page = new_page(address)
    expect(page.locator("#access-button")).to_be_visible()
    assert "token to operate" in mark(page)
    page.goto(f"{address}/#token={OPERATE.replace('+', '%2B')}")
    expect(page.locator("#access-button")).to_have_text("Operator")
    assert "±" in mark(page)
    assert "token" not in page.url
    assert page.evaluate("() => document.cookie + JSON.stringify(localStorage)").find("operate") == -1
    page.reload()
    expect(page.locator("#session-said")).to_have_text(re.compile("."))
    expect(page.locator("#access-button")).to_have_text("Operator")


def test_a_token_may_be_typed_and_a_wrong_one_is_said(stage: Stage, new_page: OpenPage) -> None:
    """Where viewing needs one too the page asks by itself; the view token shows, the other one orders."""
    page = new_page(guarded(stage, "typed", operate=OPERATE, view=VIEW))
    expect(page.locator("#access")).to_be_visible()
    expect(page.locator("#disconnected")).to_be_visible()
    page.locator("#access-token").fill("guess")
    page.keyboard.press("Enter")
    expect(page.locator("#access-said")).to_have_text("this is no token of this study")
    page.locator("#access-token").fill(VIEW)
    page.keyboard.press("Enter")
    expect(page.locator("#disconnected")).to_be_hidden()
    assert "may view, not operate" in mark(page)
    page.locator("#access-button").click()
    page.locator("#access-token").fill(OPERATE)
    page.keyboard.press("Enter")
    expect(page.locator("#access-button")).to_have_text("Operator")
    assert "±" in mark(page)


def test_who_logs_out_may_do_what_everybody_may(stage: Stage, new_page: OpenPage) -> None:
    """The role is shown; after the log-out the page asks for a token again, and a reload does not bring the old one."""
    address = guarded(stage, "leaves", operate=OPERATE, view=VIEW)
    page = new_page(f"{address}/#token={OPERATE.replace('+', '%2B')}")
    expect(page.locator("#access-button")).to_have_text("Operator")
    page.locator("#access-button").click()
    expect(page.locator("#access-why")).to_contain_text("You may operate")
    page.locator("#access-leave").click()
    expect(page.locator("#access")).to_be_visible()
    expect(page.locator("#disconnected")).to_be_visible()
    page.locator("#access-token").fill(VIEW)
    page.keyboard.press("Enter")
    expect(page.locator("#access-button")).to_have_text("View only…")


def test_every_tab_follows_the_login(stage: Stage, new_page: OpenPage) -> None:
    """Logged out in one, none orders any more; where viewing needs a token all ask for one, until one is typed."""
    address = guarded(stage, "tabs", operate=OPERATE, view=VIEW)
    page = new_page(f"{address}/#token={OPERATE.replace('+', '%2B')}")
    expect(page.locator("#access-button")).to_have_text("Operator")
    other = page.context.new_page()
    other.goto(address)
    expect(other.locator("#access-button")).to_have_text("Operator")
    page.locator("#access-button").click()
    page.locator("#access-leave").click()
    expect(other.locator("#access")).to_be_visible()
    expect(other.locator("#disconnected")).to_contain_text("A token is needed to see this study")
    page.locator("#access-token").fill(VIEW)
    page.keyboard.press("Enter")
    expect(other.locator("#access")).to_be_hidden()
    expect(other.locator("#access-button")).to_have_text("View only…")
    page.locator("#access-button").click()
    page.locator("#access-token").fill(OPERATE)
    page.keyboard.press("Enter")
    expect(other.locator("#access-button")).to_have_text("Operator")
    assert "±" in mark(other)

"""Who wears what, changed on the page: the real registry, a driver that moves its topics and one that does not."""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import http_fuzz
import pytest
from playwright.sync_api import Page, expect
from processes import poll

sys.path.insert(0, str(Path(__file__).parent))

from gui_looks import picture
from gui_stage import Process, Stage

pytestmark = pytest.mark.usefixtures("chromium")
OpenPage = Callable[..., Page]


@pytest.fixture(scope="module")
def address(stage: Stage) -> Iterator[str]:
    """The page of a study with the real registry, which knows the sensors."""
    gui, address = stage.gui()
    study = stage.study()
    database = f"database:={stage.folder}/registry.sqlite"
    registry = stage.start("registry", "-m", "metadata_registry", "--ros-args", "-p", database)
    poll(lambda: all(sensor in known(registry) for sensor in (b"glove_1", b"verity_1")), lambda: str(known(registry)))
    yield address
    study.tell("quit")
    study.stop()
    assert gui.stop() == 0


def known(registry: Process) -> bytes:
    """What it says of sensors over HTTP; nothing before it can."""
    port = re.search(r"metrics on port (\d+)", registry.log.read_text())
    return http_fuzz.told(int(port[1]), "/sensors")[1] if port else b""


def choose(page: Page, person: str, sensor: str) -> None:
    """Choose the first stream of a person's sensor."""
    card = page.locator(f"#participants .card[aria-label='participant {person}']")
    card.get_by_role("button", name=re.compile(f"^{sensor}:")).click()
    expect(page.locator("#details h2")).to_contain_text(sensor)


def assigned(page: Page) -> str:
    """The answer to the order, given by the keyboard."""
    page.keyboard.press("Enter")
    said = page.locator(".wearer .said")
    expect(said).to_have_attribute("data-kind", re.compile("ok|bad"))
    return said.text_content() or ""


def test_a_sensor_is_given_to_somebody_new_by_keyboard_and_moves(address: str, new_page: OpenPage) -> None:
    """A name that is none is refused in words; a right one is done once the topics bear it, and the page follows."""
    page = new_page(address)
    choose(page, "p2", "glove_1")
    said = page.locator(".wearer .said")
    page.keyboard.press("w")
    expect(page.locator("#wearer")).to_be_focused()
    expect(page.locator("#wearer")).to_have_value("p2")
    page.locator("#wearer").select_option(label="somebody new…")
    page.keyboard.type("p 3")
    page.keyboard.press("Enter")
    expect(said).to_have_text(re.compile("'p 3' is no pseudonym"))
    picture(page, "assign-refused")
    page.get_by_label("pseudonym of somebody new").fill("p3")
    poll(lambda: "no metadata-registry" not in assigned(page), "the registry's answer")
    expect(said).to_have_text("sensor_id 'glove_1' is assigned to human_id 'p3'")
    moved = page.locator("#participants .card[aria-label='participant p3']")
    expect(moved.get_by_role("button", name=re.compile("^glove_1:"))).to_be_visible()
    expect(page.locator("#details h2")).to_contain_text("glove_1")
    expect(page.locator("#wearer")).to_have_value("p3")
    page.wait_for_function("() => globalThis.sense4hri.lanes.lanes.get('p3/flexion/glove_1')?.line.newest > 0")
    expect(page.locator("#participants .card[aria-label='participant p2']")).not_to_contain_text("glove_1")
    picture(page, "assign-moved")


def test_a_driver_that_does_not_move_its_topics_is_told(address: str, new_page: OpenPage) -> None:
    """On a screen as small as a phone's: not moved yet, not done and why; the registry's sentence stays beside it."""
    page = new_page(address, size=(390, 844))
    choose(page, "p1", "verity_1")
    page.locator("#wearer").select_option("p2")
    page.get_by_role("button", name="Assign").click()
    said = page.locator(".wearer .said")
    expect(said).to_have_text("verity_1: p2 was asked for, not moved yet …")
    expect(said).to_have_text(re.compile("not done: .*still on 'p1'.*does not move its topics"))
    told = page.locator(".wearer .reasons li")
    expect(told).to_have_text(re.compile("human_id 'p2' was asked for, but its topics are under 'p1'"))
    expect(page.locator("#wearer")).to_have_value("p1")
    expect(page.locator(".problem .sentence", has_text="verity_1: human_id 'p2' was asked for")).to_be_visible()
    told.scroll_into_view_if_needed()
    picture(page, "assign-not-done-phone")
    page.set_viewport_size({"width": 1280, "height": 800})
    picture(page, "assign-not-done")


def test_what_is_asked_while_an_order_is_under_way_is_asked_next(address: str, new_page: OpenPage) -> None:
    """Nothing that was chosen is lost: the second sensor moves once the first order is answered."""
    page = new_page(address)
    choose(page, "p1", "verity_1")
    page.locator("#wearer").select_option("p2")
    page.get_by_role("button", name="Assign").click()
    expect(page.locator(".wearer .said")).to_have_text("verity_1: p2 was asked for, not moved yet …")
    glove = page.get_by_role("button", name=re.compile("^glove_1:"))
    wearer = page.locator("#participants .card", has=glove).get_attribute("aria-label") or ""
    glove.click()
    expect(page.locator("#details h2")).to_contain_text("glove_1")
    assert page.locator("#wearer").input_value() == wearer.removeprefix("participant ")  # not whom the other is to have
    page.locator("#wearer").select_option("p1")
    page.get_by_role("button", name="Assign").click()
    moved = page.locator("#participants .card[aria-label='participant p1']")
    expect(moved.get_by_role("button", name=re.compile("^glove_1:"))).to_be_visible()

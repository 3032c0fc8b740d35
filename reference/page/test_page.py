"""The report in a browser: it draws and plays, asks for nothing from outside, and fits where it is shown."""

import io
import time
from contextlib import contextmanager

import pytest
from PIL import Image, ImageChops, ImageStat

WIDE = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}


@contextmanager
def opened(browser, address, *, complaints_allowed=False, **settings):
    """The page in a browser of its own; at the end, that it neither complained nor asked for anything."""
    settings = {"viewport": WIDE, "reduced_motion": "reduce", **settings}
    context = browser.new_context(**settings)
    page = context.new_page()
    complaints, requests = [], []
    page.on("console", lambda message: complaints.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(address)
    yield page
    context.close()
    assert requests == [address]
    if not complaints_allowed:
        assert complaints == []


def picture(thing):
    return Image.open(io.BytesIO(thing.screenshot())).convert("RGB")


def changed(before, after):
    """Share of the pixels that are not the same."""
    assert before.size == after.size
    difference = ImageChops.difference(before, after).convert("L").point(lambda value: 255 if value > 8 else 0)
    return ImageStat.Stat(difference).mean[0] / 255


def brightness(image):
    return ImageStat.Stat(image.convert("L")).mean[0]


def eventually(page, holds):
    """Whether it comes to hold before one loses patience: a slow machine draws late."""
    patience = time.monotonic() + 15
    while not holds():
        if time.monotonic() > patience:
            return False
        page.wait_for_timeout(100)
    return True


def canvas(page):
    found = page.locator("#view-canvas")
    found.scroll_into_view_if_needed()
    return found


def go_to(page, share):
    """Sets the time by hand, as a share of the run."""
    page.locator("#view-time").evaluate(
        "(slider, share) => { slider.value = Math.round(share * slider.max); slider.dispatchEvent(new Event('input')); }", share)
    # A frame is drawn before the next but one.
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_and_has_the_colours_asked_for(browser, address, pictures, scheme, size):
    with opened(browser, address, viewport=size, color_scheme=scheme) as page:
        view = canvas(page)
        go_to(page, 0.5)
        width = page.evaluate("[document.scrollingElement.scrollWidth, document.scrollingElement.clientWidth]")
        assert width[0] <= width[1] == size["width"]
        wanted = (lambda value: value > 150) if scheme == "light" else (lambda value: value < 105)
        assert wanted(brightness(picture(view)))
        assert wanted(brightness(picture(page.locator("figure svg").first)))
        assert wanted(brightness(picture(page.locator("ul.verdicts"))))
        if pictures:
            name = f"{scheme}-{size['width']}"
            view.screenshot(path=pictures / f"{name}-view.png")
            page.screenshot(path=pictures / f"{name}-page.png", full_page=True)


def test_the_view_draws_and_shows_the_run(browser, address):
    with opened(browser, address) as page:
        view = canvas(page)
        go_to(page, 0)
        begin, words = picture(view), page.locator("#view-text").inner_text()
        colours = begin.getcolors(maxcolors=1 << 20)
        assert len(colours) > 50
        # The ground and a body in front of it, both of some size.
        assert max(count for count, _ in colours) < 0.9 * begin.width * begin.height
        go_to(page, 0.9)
        later = picture(view)
        assert changed(begin, later) > 0.005
        assert page.locator("#view-text").inner_text() != words
        # And the same again for the same time.
        go_to(page, 0)
        assert changed(begin, picture(view)) == 0


def test_it_plays_and_pauses(browser, address):
    with opened(browser, address) as page:
        view = canvas(page)
        page.locator("#view-speed").select_option("0.1")
        go_to(page, 0.5)
        button = page.get_by_role("button", name="Play")
        button.click()
        assert page.locator("#view-play").inner_text() == "Pause"
        before, at = picture(view), int(page.locator("#view-time").input_value())
        page.wait_for_function("(at) => Number(document.getElementById('view-time').value) > at + 1", arg=at, timeout=20_000)
        assert eventually(page, lambda: changed(before, picture(view)) > 0)
        page.get_by_role("button", name="Pause").click()
        stands = page.locator("#view-time").input_value()
        page.wait_for_timeout(500)
        assert page.locator("#view-time").input_value() == stands


@pytest.mark.parametrize("wish", ["reduce", "no-preference"])
def test_it_begins_by_itself_only_where_motion_is_welcome(browser, address, wish):
    with opened(browser, address, reduced_motion=wish) as page:
        canvas(page)
        begun = lambda: page.locator("#view-play").inner_text() == "Pause" and int(page.locator("#view-time").input_value()) > 0
        if wish == "no-preference":
            assert eventually(page, begun)
        else:
            page.wait_for_timeout(1000)
            assert page.locator("#view-play").inner_text() == "Play"
            assert page.locator("#view-time").input_value() == "0"


def test_pointer_and_keys_turn_it(browser, address):
    with opened(browser, address) as page:
        view = canvas(page)
        go_to(page, 0.5)
        before = picture(view)
        box = view.bounding_box()
        page.mouse.move(box["x"] + 300, box["y"] + 200)
        page.mouse.down()
        page.mouse.move(box["x"] + 400, box["y"] + 230, steps=5)
        page.mouse.up()
        assert eventually(page, lambda: changed(before, picture(view)) > 0.02)
        page.get_by_role("button", name="Reset view").click()
        assert eventually(page, lambda: changed(before, picture(view)) < 0.002)
        view.focus()
        for key in ("ArrowLeft", "ArrowUp", "+"):
            at = picture(view)
            page.keyboard.press(key)
            assert eventually(page, lambda: changed(at, picture(view)) > 0.005), key
        page.keyboard.press(" ")
        assert page.locator("#view-play").inner_text() == "Pause"


def test_every_scene_can_be_chosen(browser, address):
    with opened(browser, address) as page:
        view = canvas(page)
        scenes = page.get_by_role("combobox", name="Scene").locator("option").all_inner_texts()
        assert len(scenes) == 2
        pictures_of = []
        for scene in scenes:
            page.get_by_role("combobox", name="Scene").select_option(label=scene)
            go_to(page, 1)
            assert scene in view.get_attribute("aria-label")
            pictures_of.append(picture(view))
        assert changed(*pictures_of) > 0.005


def test_every_control_has_a_name(browser, address):
    with opened(browser, address) as page:
        for control in page.locator("button, input, select, canvas").all():
            name = control.evaluate("(e) => e.getAttribute('aria-label') ?? e.labels?.[0]?.textContent ?? e.textContent")
            assert name.strip() != ""
        sections = page.evaluate("[...document.querySelectorAll('a')].map((a) => [a.getAttribute('href'), !!document.querySelector(a.hash)])")
        assert sections and all(href.startswith("#") and there for href, there in sections)


def test_without_webgl_it_says_so(start, address):
    with opened(start("--disable-3d-apis"), address, complaints_allowed=True) as page:
        assert page.locator("#view-none").is_visible()
        assert not page.locator("#view-stage").is_visible()
        assert page.locator("#provenance").is_visible()

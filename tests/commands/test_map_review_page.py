"""The page of `percept map review` in a browser: by keys, with things going wrong."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from made_review_run import make_review_run
from playwright.sync_api import Browser, BrowserContext, Page, Response, expect, sync_playwright
from review_process import review_server

from percept.core.map_findings import Status
from percept.review import read_decisions, read_run

_PATIENCE_MS = 60_000  # spent only where something is wrong
_SCRIPT = "<script>alert(1)</script><img src=x onerror=alert(2)>"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("there is no chromium on this computer")
    with sync_playwright() as playwright:
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=program, args=options)
        yield browser
        browser.close()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    """A browser that has seen nothing yet; whatever goes wrong in its pages fails the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(_PATIENCE_MS)
    expect.set_options(timeout=_PATIENCE_MS)
    errors: list[str] = []
    context.on("weberror", lambda error: errors.append(str(error.error)))
    context.on("dialog", lambda dialog: errors.append(f"dialog: {dialog.message}"))
    yield context
    context.close()
    assert not errors


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return make_review_run(tmp_path / "run", findings=300)


def _open(context: BrowserContext, address: str) -> Page:
    page = context.new_page()
    page.goto(address)
    expect(page.locator("#map")).to_have_attribute("data-lines", "19")
    return page


def _states(page: Page) -> list[str]:
    return page.locator("#rows li .state").all_text_contents()


def _shown(page: Page) -> str:
    return page.locator("#facts dd").last.inner_text()


def _view(page: Page) -> dict[str, float]:
    """Return what the map shows once it is drawn: the place of its middle, pixels a metre."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    canvas = page.locator("#map")
    return {
        name: float(canvas.get_attribute(f"data-{name}") or "nan") for name in ("x", "y", "scale")
    }


def _press_and_wait(page: Page, key: str, said: str) -> None:
    page.keyboard.press(key)
    expect(page.locator("#saved")).to_have_text(f"saved: {said}")


def test_what_is_decided_by_keys_is_found_again(context: BrowserContext, run: Path) -> None:
    with review_server(run) as (address, process):
        page = _open(context, address)
        assert "token" not in page.url
        ids = [finding.finding_id for finding in read_run(run).findings]
        assert _shown(page) == ids[0]
        _press_and_wait(page, "c", "confirmed")
        assert _shown(page) == ids[1]
        page.keyboard.press("j")
        page.keyboard.press("j")
        page.keyboard.press("k")
        assert _shown(page) == ids[2]
        _press_and_wait(page, "r", "rejected")
        page.keyboard.press("k")
        page.keyboard.press("k")
        assert _shown(page) == ids[1]
        page.keyboard.press("m")
        page.keyboard.type("worn paint, c r u are no keys here")
        expect(page.locator("#draft")).to_be_visible()
        _press_and_wait(page, "Enter", "comment")
        _press_and_wait(page, "u", "unsure")
        assert _shown(page) == ids[3]  # the next open one
        assert _states(page)[:4] == ["confirmed", "unsure", "rejected", "open"]
        expect(page.locator("#count")).to_have_text("3 of 300 decided")
        page.reload()
        assert _states(page)[:4] == ["confirmed", "unsure", "rejected", "open"]
        assert _shown(page) == ids[3]
        page.keyboard.press("k")
        page.keyboard.press("k")
        expect(page.locator("#comment")).to_have_value("worn paint, c r u are no keys here")
        expect(page.locator("#history li")).to_have_count(2)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
    assert {path.name for path in run.glob("*sqlite*")} == {"review.sqlite"}
    with review_server(run) as (address, _):
        assert _states(_open(context, address))[:4] == ["confirmed", "unsure", "rejected", "open"]
    decisions = {
        decision.finding_id: decision for decision in read_decisions(run / "review.sqlite")
    }
    assert decisions[ids[1]].status is Status.UNSURE
    assert decisions[ids[1]].comment == "worn paint, c r u are no keys here"


def test_undo_and_open_again(context: BrowserContext, run: Path) -> None:
    with review_server(run) as (address, _):
        page = _open(context, address)
        _press_and_wait(page, "c", "confirmed")
        _press_and_wait(page, "r", "rejected")
        _press_and_wait(page, "z", "undone, open")
        _press_and_wait(page, "z", "undone, open")
        assert _states(page)[:2] == ["open", "open"]
        page.keyboard.press("z")
        expect(page.locator("#saved")).to_have_text("nothing to undo in this tab")
        page.get_by_role("button", name="Confirm").click()
        expect(page.locator("#saved")).to_have_text("saved: confirmed")
        page.keyboard.press("k")
        _press_and_wait(page, "o", "open")
        assert _states(page)[0] == "open"
        assert read_decisions(run / "review.sqlite") == []


def test_what_was_acknowledged_survives_a_kill(context: BrowserContext, run: Path) -> None:
    acknowledged = []
    ids = [finding.finding_id for finding in read_run(run).findings]
    with review_server(run) as (address, process):
        page = _open(context, address)
        answers: list[Response] = []
        page.on("response", lambda answer: answers.append(answer))
        for number in range(40):
            page.keyboard.press("cru"[number % 3])
            if number == 5:
                expect(page.locator("#rows li .state").first).to_have_text("confirmed")
            if number == 25:
                process.kill()  # in the middle of what was typed
        expect(page.locator("#saved")).to_have_text("not saved")
        acknowledged = [
            row for row, state in zip(ids, _states(page), strict=True) if state != "open"
        ]
        expect(page.locator("#trouble")).to_contain_text("No connection")
        saved = [one for one in answers if one.url.endswith("decide") and one.status == 200]
        assert len(saved) == len(acknowledged) > 0
        # What was not acknowledged is not shown as decided, and a comment waits on the page.
        page.keyboard.press("m")
        page.keyboard.type("kept for later")
        page.keyboard.press("Enter")
        expect(page.locator("#saved")).to_have_text("not saved")
        expect(page.locator("#comment")).to_have_value("kept for later")
        expect(page.locator("#draft")).to_be_visible()
    kept = {decision.finding_id for decision in read_decisions(run / "review.sqlite")}
    assert set(acknowledged) <= kept
    assert len(kept) <= len(acknowledged) + 1  # one may have been written and not answered
    with review_server(run) as (address, _):
        states = _states(_open(context, address))
    assert {i for i, state in zip(ids, states, strict=True) if state != "open"} == kept


def test_a_server_that_comes_back_takes_the_comment(context: BrowserContext, run: Path) -> None:
    with review_server(run) as (address, process):
        port = address.split(":")[2].split("/")[0]
        page = _open(context, address)
        process.kill()
        process.wait()
        page.keyboard.press("m")
        page.keyboard.type("written while it was down")
        page.keyboard.press("Enter")
        expect(page.locator("#saved")).to_have_text("not saved")
    with review_server(run, "--port", port) as (address, _):
        page.keyboard.press("Enter")
        expect(page.locator("#trouble")).to_contain_text("printed last")
        page.goto(address)  # with another token
        expect(page.locator("#comment")).to_have_value("written while it was down")
        page.keyboard.press("m")
        _press_and_wait(page, "Enter", "comment")


def test_two_tabs_never_write_over_each_other(context: BrowserContext, run: Path) -> None:
    with review_server(run) as (address, _):
        one, two = _open(context, address), _open(context, address)
        # The second tab hears nothing of the first for now, as one that sleeps.
        two.route("**/state?*", lambda route: route.abort())
        one.bring_to_front()
        one.keyboard.press("m")
        one.keyboard.type("first")
        one.keyboard.press("Escape")
        _press_and_wait(one, "c", "confirmed")
        two.bring_to_front()
        two.keyboard.press("r")
        expect(two.locator("#saved")).to_have_text("not saved")
        expect(two.locator("#trouble")).to_contain_text("decided in another tab")
        expect(two.locator("#badge")).to_have_text("confirmed")
        expect(two.locator("#comment")).to_have_value("first")
        assert [d.status for d in read_decisions(run / "review.sqlite")] == [Status.CONFIRMED]
        _press_and_wait(two, "r", "rejected")  # knowing it, the person may
        one.bring_to_front()
        expect(one.locator("#rows li").first.locator(".state")).to_have_text("rejected")
        expect(one.locator("#saved")).to_have_text("changed in another tab")


def test_names_of_the_run_stay_text_and_nobody_else_is_asked(
    context: BrowserContext, tmp_path: Path
) -> None:
    names = {"expected": _SCRIPT, "observed": _SCRIPT, "sensor": _SCRIPT, "id": _SCRIPT}
    row = {**names, "kind": "global_offset", "confidence": 1.0, "status": "open"}
    run = make_review_run(tmp_path / "<img src=x onerror=alert(3)>", findings=5, rows=[row])
    requests: list[str] = []
    context.on("request", lambda request: requests.append(request.url))
    with review_server(run) as (address, _):
        page = _open(context, address)
        page.on("dialog", lambda dialog: pytest.fail(dialog.message))
        assert _shown(page) == _SCRIPT
        assert _SCRIPT in page.locator("#claim").inner_text()
        assert page.locator("h1").inner_text().startswith("<img src=x")
        page.keyboard.press("m")
        page.keyboard.type(_SCRIPT)
        _press_and_wait(page, "Enter", "comment")
        expect(page.locator("#history li")).to_contain_text(_SCRIPT)
        page.reload()
        expect(page.locator("#comment")).to_have_value(_SCRIPT)
        assert page.evaluate("document.querySelectorAll('[onerror], main script').length") == 0
        home = address.split("?")[0]
        assert requests
        assert not [url for url in requests if not url.startswith(home)]
        # And if a name did become an element, it would not run.
        page.evaluate(
            "document.body.insertAdjacentHTML('beforeend', '<img src=y onerror=\"window.ran=1\">')"
        )
        fetched = "fetch('https://example.org/').then(() => 'answered', () => 'refused')"
        assert page.evaluate(fetched) == "refused"
        assert page.evaluate("window.ran") is None


def test_a_page_of_another_origin_cannot_decide(context: BrowserContext, run: Path) -> None:
    with review_server(run) as (address, _):
        page = _open(context, address)
        home = address.split("?")[0]
        evil = context.new_page()
        evil.route(
            "http://evil.example/",
            lambda route: route.fulfill(body="<p>", content_type="text/html"),
        )
        evil.goto("http://evil.example/")
        identity = read_run(run).findings[0].finding_id
        body = f'{{"id": "{identity}", "status": "rejected", "comment": "", "after": 0}}'
        for kind in ("application/json", "text/plain"):
            evil.evaluate(
                "([url, body, kind]) => fetch(url + 'decide', {method: 'POST', mode: 'no-cors', "
                "credentials: 'include', headers: {'Content-Type': kind}, body}).catch(() => 0)",
                [home, body, kind],
            )
        assert evil.evaluate("url => fetch(url + 'map.json').then(() => 1, () => 0)", home) == 0
        assert read_decisions(run / "review.sqlite") == []
        assert _states(page)[0] == "open"


def test_the_map_moves_by_keys_and_mouse(context: BrowserContext, tmp_path: Path) -> None:
    run = make_review_run(tmp_path / "run", findings=300, pictures=False)
    with review_server(run) as (address, _):
        page = _open(context, address)
        canvas = page.locator("#map")
        finding = next(f for f in read_run(run).findings if f.finding_id == _shown(page))
        placed = _view(page)
        assert (placed["x"], placed["y"]) == pytest.approx((finding.x_m, finding.y_m))
        page.keyboard.press("+")
        assert _view(page)["scale"] == pytest.approx(1.4 * placed["scale"])
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowUp")
        assert _view(page)["x"] > placed["x"]
        assert _view(page)["y"] > placed["y"]
        page.keyboard.press("f")
        assert _view(page) == pytest.approx(placed)
        box = canvas.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.wheel(0, -300)
        assert _view(page)["scale"] > placed["scale"]
        zoomed = _view(page)
        page.mouse.down()
        page.mouse.move(x + 60, y + 30, steps=3)
        page.mouse.up()
        assert _view(page)["x"] == pytest.approx(zoomed["x"] - 60 / zoomed["scale"])
        assert _view(page)["y"] == pytest.approx(zoomed["y"] + 30 / zoomed["scale"])
        page.keyboard.press("0")
        assert _view(page)["scale"] < placed["scale"]
        before = canvas.screenshot()
        page.keyboard.press("1")
        _view(page)
        assert canvas.screenshot() != before


def test_the_list_is_filtered(context: BrowserContext, run: Path) -> None:
    with review_server(run) as (address, _):
        page = _open(context, address)
        moved = sum(finding.kind == "moved" for finding in read_run(run).findings)
        page.locator("#kind").select_option("moved")
        expect(page.locator("#rows li:visible")).to_have_count(moved)
        expect(page.locator("#name")).to_have_text("moved")
        page.locator("#status").select_option("open")
        _press_and_wait(page, "c", "confirmed")
        expect(page.locator("#rows li:visible")).to_have_count(moved - 1)
        page.keyboard.press("/")
        page.keyboard.type("no such words")
        expect(page.locator("#none")).to_be_visible()
        page.keyboard.press("Escape")
        page.keyboard.press("?")
        expect(page.get_by_role("heading", name="Keys")).to_be_visible()
        page.keyboard.press("c")  # keys of the page rest while help is open
        page.keyboard.press("Escape")
        expect(page.get_by_role("heading", name="Keys")).to_be_hidden()
        assert len(read_decisions(run / "review.sqlite")) == 1


def test_evidence_is_shown_or_missed_in_words(context: BrowserContext, run: Path) -> None:
    findings = read_run(run).findings
    with review_server(run) as (address, _):
        page = _open(context, address)
        for has in (True, False):
            index = next(i for i, f in enumerate(findings) if bool(f.evidence) is has)
            page.locator("#rows li").nth(index).click()
            expect(page.locator("#evidence")).to_be_visible(visible=has)
            expect(page.locator("#no-evidence")).to_be_visible(visible=not has)
            if has:
                expect(page.locator("#evidence")).to_have_js_property("naturalWidth", 1286)
                # The picture took room from the map: the finding fills what is left of it.
                placed = _view(page)
                page.keyboard.press("f")
                assert _view(page) == pytest.approx(placed)


def test_a_run_without_findings_is_friendly(context: BrowserContext, tmp_path: Path) -> None:
    run = make_review_run(tmp_path / "run", findings=0)
    with review_server(run) as (address, _):
        page = context.new_page()
        page.goto(address)
        expect(page.get_by_role("heading", name="Nothing to decide")).to_be_visible()
        page.keyboard.press("?")
        expect(page.get_by_role("heading", name="Keys")).to_be_visible()

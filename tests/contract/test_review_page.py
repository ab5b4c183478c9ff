"""The review's server: who may talk to it, what it gives away, and what it says."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from made_review_run import make_review_run
from starlette.testclient import TestClient

from percept.core.map_findings import Status
from percept.review import ReviewRun, ReviewStore, read_run
from percept.review.app import make_app
from percept.review.guard import TOKEN_HEADER

_PORT = 8123
_HOME = f"http://127.0.0.1:{_PORT}"
_TOKEN = "t0ken_of-the-test"  # noqa: S105 - no secret
_SCRIPT = "</script><script>alert(1)</script><img src=x onerror=alert(1)>\u2028&lt;"


@pytest.fixture
def run(tmp_path: Path) -> ReviewRun:
    hostile = {
        "id": _SCRIPT,
        "kind": "type",
        "status": "open",
        "sensor": _SCRIPT,
        "expected": _SCRIPT,
    }
    rows = [{"evidence": ""}, {**hostile, "observed": _SCRIPT, "evidence": f"evidence/{_SCRIPT}"}]
    return read_run(make_review_run(tmp_path / "<b>run", findings=30, rows=rows))


@pytest.fixture
def store(run: ReviewRun) -> Iterator[ReviewStore]:
    with ReviewStore(run.folder / "review.sqlite") as store:
        yield store


@pytest.fixture
def stranger(run: ReviewRun, store: ReviewStore) -> TestClient:
    """Return a client that knows the address and no token."""
    return TestClient(make_app(run, store, _TOKEN, port=_PORT), base_url=_HOME)


@pytest.fixture
def client(stranger: TestClient) -> TestClient:
    assert stranger.get(f"/?token={_TOKEN}").status_code == 200
    stranger.headers["Origin"] = _HOME
    return stranger


def _decision(run: ReviewRun, **changes: Any) -> dict[str, Any]:
    said = {"id": run.findings[3].finding_id, "status": "confirmed", "comment": "", "after": 0}
    return {**said, **changes}


_PATHS = ["/", "/map.json", "/state", "/history?id=a", "/evidence?id=a", "/static/page.js", "/none"]


@pytest.mark.parametrize("path", _PATHS)
def test_without_the_token_there_is_nothing(stranger: TestClient, path: str) -> None:
    wrong = [
        {},
        {TOKEN_HEADER: "wrong"},
        {"Cookie": f"percept_review_{_PORT}=wrong"},
        {"Cookie": '="'},
    ]
    for headers in wrong:
        answer = stranger.get(path, headers=headers)
        assert (answer.status_code, "set-cookie" in answer.headers) == (403, False)
        assert "findings" not in answer.text
    assert stranger.get("/?token=wrong").status_code == 403
    assert stranger.get(f"/?token={_TOKEN}&token=x").status_code == 403
    assert stranger.get(f"/map.json?token={_TOKEN}").status_code == 403


def test_the_cookie_is_for_this_page_alone(stranger: TestClient) -> None:
    answer = stranger.get(f"/?token={_TOKEN}")
    cookie = answer.headers["set-cookie"]
    assert cookie == f"percept_review_{_PORT}={_TOKEN}; HttpOnly; SameSite=Strict; Path=/"
    again = stranger.get("/")
    assert again.status_code == 200
    assert "set-cookie" not in again.headers
    assert _TOKEN not in again.text


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Origin": f"https://127.0.0.1:{_PORT}"},
        {"Origin": "http://127.0.0.1:9"},
        {"Origin": f"http://localhost:{_PORT}"},  # not the host that is asked
        {"Host": "evil.example", "Origin": "http://evil.example"},
        {"Host": f"evil.example:{_PORT}"},
        {"Host": "127.0.0.1"},
        {"Host": f"127.0.0.1:{_PORT}.evil.example"},
    ],
)
def test_another_page_is_refused(
    client: TestClient, store: ReviewStore, run: ReviewRun, headers: dict[str, str]
) -> None:
    assert client.get("/", headers=headers).status_code == 403
    assert client.post("/decide", json=_decision(run), headers=headers).status_code == 403
    assert store.latest() == []


def test_a_change_names_its_origin_or_brings_the_token(
    client: TestClient, store: ReviewStore, run: ReviewRun
) -> None:
    del client.headers["Origin"]
    assert client.post("/decide", json=_decision(run)).status_code == 403
    assert store.latest() == []
    client.cookies.clear()
    by_header = client.post("/decide", json=_decision(run), headers={TOKEN_HEADER: _TOKEN})
    assert by_header.status_code == 200
    assert len(store.latest()) == 1


def test_reading_changes_nothing(client: TestClient, store: ReviewStore, run: ReviewRun) -> None:
    said = "&".join(f"{key}={value}" for key, value in _decision(run).items())
    for path in (*_PATHS, f"/decide?{said}", f"/?{said}"):
        for method in ("GET", "HEAD", "OPTIONS"):
            client.request(method, path)
    assert client.get(f"/decide?{said}").status_code == 405
    for method in ("PUT", "DELETE", "PATCH"):
        assert client.request(method, "/decide").status_code == 405
    assert store.latest() == []


def test_a_form_of_another_page_is_no_decision(
    client: TestClient, store: ReviewStore, run: ReviewRun
) -> None:
    body = json.dumps(_decision(run))
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""):
        answer = client.post("/decide", content=body, headers={"Content-Type": kind})
        assert answer.status_code == 415
    assert store.latest() == []


@pytest.mark.parametrize("path", [*_PATHS, "/decide"])
def test_every_answer_binds_the_browser(client: TestClient, path: str) -> None:
    for answer in (client.get(path), client.get(path, headers={"Origin": "http://evil.example"})):
        policy = answer.headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'; img-src")
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert "server" not in answer.headers


def test_names_stay_text(client: TestClient, run: ReviewRun) -> None:
    page = client.get("/").text
    assert len(re.findall("<script", page)) == 2  # the page's own, and the data
    assert "<img src=x" not in page
    assert "<b>run" not in page
    assert "&lt;b&gt;run" in page
    island = re.search(r'<script type="application/json" id="findings">(.*?)</script>', page, re.S)
    assert island
    assert "<" not in island.group(1)
    values = {row["id"]: row for row in json.loads(unescape(island.group(1)))}
    assert values[_SCRIPT]["sensor"] == _SCRIPT
    assert len(values) == len(run.findings)


def test_the_page_asks_nobody_else() -> None:
    package = Path(make_app.__code__.co_filename).parent
    for path in [*package.glob("static/*"), *package.glob("templates/*")]:
        outside = re.findall(r"(?:https?:)?//[\w.]+", path.read_text(encoding="utf-8"))
        assert {text for text in outside if "w3.org" not in text} <= set(), path
        assert " style=" not in path.read_text(encoding="utf-8") or path.suffix == ".js"


def test_a_decision_is_answered_as_it_stands(
    client: TestClient, store: ReviewStore, run: ReviewRun
) -> None:
    answer = client.post("/decide", json=_decision(run, comment="<b>ä"))
    assert answer.status_code == 200
    entry = answer.json()["entry"]
    assert (entry["status"], entry["comment"], entry["revision"]) == ("confirmed", "<b>ä", 1)
    (decision,) = store.decisions()
    finding = run.findings[3]
    assert decision.x_m == finding.x_m
    assert (decision.along_m, decision.length_m) == (finding.along_m, finding.length_m)
    late = client.post("/decide", json=_decision(run, status="rejected"))
    assert late.status_code == 409
    assert late.json()["entry"] == entry
    assert (
        client.post("/decide", json=_decision(run, status="rejected", after=1)).status_code == 200
    )
    assert [e["revision"] for e in client.get("/state?since=1").json()["entries"]] == [2]
    history = client.get("/history", params={"id": finding.finding_id}).json()["entries"]
    assert [e["status"] for e in history] == ["confirmed", "rejected"]
    assert store.decisions()[0].status is Status.REJECTED


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"id": "none"}, 404),
        ({"id": 3}, 422),
        ({"status": "perhaps"}, 422),
        ({"after": -1}, 422),
        ({"after": True}, 422),
        ({"after": 2**70}, 422),
        ({"comment": None}, 422),
        ({"comment": "x" * 4001}, 422),
        ({"comment": "x" * 70_000}, 413),
        ({"comment": "\ud800"}, 422),
    ],
)
def test_what_is_no_decision_is_refused(
    client: TestClient, store: ReviewStore, run: ReviewRun, changes: dict[str, Any], code: int
) -> None:
    body = json.dumps(_decision(run, **changes))
    answer = client.post("/decide", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == code
    assert answer.json()["error"]
    assert store.latest() == []


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"\xff", b"[" * 60_000])
def test_a_body_that_is_no_json_is_refused(client: TestClient, body: bytes) -> None:
    answer = client.post("/decide", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert client.get("/state?since=x").status_code == 422


def test_a_store_that_fails_is_told_and_nothing_is_acknowledged(
    client: TestClient, store: ReviewStore, run: ReviewRun
) -> None:
    store._database.execute("PRAGMA query_only = 1")  # as a disk that turned read-only
    answer = client.post("/decide", json=_decision(run))
    assert answer.status_code == 503
    assert "cannot be read or written" in answer.json()["error"]
    store._database.execute("PRAGMA query_only = 0")
    assert store.latest() == []


def test_evidence_is_a_picture_of_the_run(client: TestClient, run: ReviewRun) -> None:
    finding = next(f for f in run.findings if f.evidence and f.finding_id != _SCRIPT)
    answer = client.get("/evidence", params={"id": finding.finding_id})
    assert answer.headers["content-type"] == "image/png"
    assert answer.content == (run.folder / finding.evidence).read_bytes()
    for identity in ("none", "", _SCRIPT, run.findings[0].evidence):
        assert client.get("/evidence", params={"id": identity}).status_code == 404


@pytest.mark.parametrize(
    "name",
    [
        "../secret.png",
        "evidence/../../secret.png",
        "evidence/../discrepancies.parquet",
        "evidence",
        "evidence/",
        "evidence/link.png",
        "evidence/folder/secret.png",
        "evidence/circle.png",
        "evidence/pipe.png",
        "evidence/page.png",
        "evidence/inner",
        "evidence/none.png",
        "evidence/\0.png",
        "/etc/passwd",
        "",
    ],
)
def test_evidence_comes_from_its_folder_alone(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "run"
    make_review_run(folder, findings=1, rows=[{"evidence": name, "id": "a"}])
    (tmp_path / "secret.png").write_bytes((folder / "evidence" / "moved.png").read_bytes())
    (folder / "evidence" / "link.png").symlink_to(tmp_path / "secret.png")
    (folder / "evidence" / "folder").symlink_to(tmp_path)
    (folder / "evidence" / "circle.png").symlink_to("circle.png")
    (folder / "evidence" / "page.png").write_text("<script>alert(1)</script>")
    (folder / "evidence" / "inner").mkdir()
    os.mkfifo(folder / "evidence" / "pipe.png")
    assert _evidence(folder).status_code == 404


def test_an_evidence_folder_that_leads_elsewhere_is_refused(tmp_path: Path) -> None:
    folder = make_review_run(
        tmp_path / "run", findings=1, rows=[{"id": "a", "evidence": "evidence/a"}]
    )
    picture = (folder / "evidence" / "moved.png").read_bytes()
    (folder / "evidence" / "a").write_bytes(picture)
    assert _evidence(folder).content == picture
    (folder / "evidence").rename(tmp_path / "elsewhere")
    (folder / "evidence").symlink_to(tmp_path / "elsewhere")
    assert _evidence(folder).status_code == 404


def _evidence(folder: Path) -> Any:
    with ReviewStore(folder / "review.sqlite") as store:
        client = TestClient(make_app(read_run(folder), store, _TOKEN, port=_PORT), base_url=_HOME)
        return client.get("/evidence?id=a", headers={TOKEN_HEADER: _TOKEN})


def test_what_an_earlier_review_said_is_shown(tmp_path: Path) -> None:
    rows = [{"id": "a", "status": "confirmed"}, {"id": "b", "status": "rejected"}]
    folder = make_review_run(tmp_path, findings=2, rows=rows)
    (folder / "run.json").write_text('{"counts": {"seen_m": "much"}}')  # not known
    with ReviewStore(folder / "review.sqlite") as store:
        run = read_run(folder)
        store.decide(run.by_id["b"].decided(Status.UNSURE, "dirt?"))
        client = TestClient(make_app(run, store, _TOKEN, port=_PORT), base_url=_HOME)
        page = client.get(f"/?token={_TOKEN}").text
    island = re.search(r'id="findings">(.*?)</script>', page, re.S)
    assert island
    shown = {row["id"]: row for row in json.loads(island.group(1))}
    assert (shown["a"]["status"], shown["a"]["revision"]) == ("confirmed", 0)
    assert (shown["b"]["status"], shown["b"]["comment"]) == ("unsure", "dirt?")
    assert "lines seen" not in page


def test_a_run_without_findings_says_so(tmp_path: Path) -> None:
    folder = make_review_run(tmp_path, findings=0)
    with ReviewStore(folder / "review.sqlite") as store:
        client = TestClient(make_app(read_run(folder), store, _TOKEN, port=_PORT), base_url=_HOME)
        page = client.get(f"/?token={_TOKEN}").text
    assert "Nothing to decide" in page
    assert "533 m of lines seen; not seen: 644 m out of view, 80 m too dark" in page
    assert "<canvas" not in page

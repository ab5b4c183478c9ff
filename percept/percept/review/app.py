"""The page and what it asks for; a GET changes nothing."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from percept.core.errors import PerceptError
from percept.core.map_findings import Status
from percept.review.claims import KIND_NAMES, coverage, entry_values, finding_values
from percept.review.evidence import read_evidence
from percept.review.guard import Guard
from percept.review.run import ReviewRun
from percept.review.store import ConflictError, Entry, ReviewStore

__all__ = ["make_app"]

_HERE = Path(__file__).parent
_LONGEST_BODY = 64 * 1024
_LONGEST_COMMENT = 4000


def make_app(run: ReviewRun, store: ReviewStore, token: str, *, port: int) -> Starlette:
    """Return the page of a run.

    Args:
        run: The run.
        store: Takes the decisions.
        token: The secret that requests have to bring.
        port: Port of the loopback interface that the page is reached by.
    """
    page = _Page(run, store)
    routes = [
        Route("/", page.show),
        Route("/map.json", page.map),
        Route("/evidence", page.evidence),
        Route("/state", page.state),
        Route("/history", page.history),
        Route("/decide", page.decide, methods=["POST"]),
        Mount("/static", StaticFiles(directory=_HERE / "static")),
    ]
    return Starlette(
        routes=routes,
        middleware=[Middleware(Guard, token=token, port=port)],
        exception_handlers={PerceptError: _explain},
    )


def _explain(_request: Request, error: Exception) -> Response:
    return _refused(503, str(error))


class _Page:
    def __init__(self, run: ReviewRun, store: ReviewStore) -> None:
        self._run = run
        self._store = store
        environment = Environment(
            loader=FileSystemLoader(_HERE / "templates"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        self._template = environment.get_template("page.html")
        self._findings = [finding_values(finding) for finding in run.findings]
        self._map = json.dumps(_map_values(run), separators=(",", ":")).encode()

    def show(self, _request: Request) -> Response:
        """The page with everything in it but the map."""
        entries = {entry.decision.finding_id: entry for entry in self._store.latest()}
        findings = [self._as_it_stands(values, entries) for values in self._findings]
        kinds = Counter(values["kind"] for values in findings)
        return HTMLResponse(
            self._template.render(
                title=self._run.folder.absolute().name,
                folder=str(self._run.folder),
                coverage=coverage(self._run),
                findings=findings,
                kinds=[(kind, name, kinds[kind]) for kind, name in KIND_NAMES.items()],
                statuses=[str(status) for status in Status],
                longest_comment=_LONGEST_COMMENT,
                revision=max((entry.revision for entry in entries.values()), default=0),
            )
        )

    def map(self, _request: Request) -> Response:
        """Lines of the map and ways of the drives."""
        return Response(self._map, media_type="application/json")

    def evidence(self, request: Request) -> Response:
        """The picture of a finding; named by the finding, so that no path comes from outside."""
        finding = self._run.by_id.get(request.query_params.get("id", ""))
        picture = None if finding is None else read_evidence(self._run.folder, finding.evidence)
        if picture is None:
            return _refused(404, "there is no such picture")
        return Response(picture, media_type="image/png")

    def state(self, request: Request) -> Response:
        """What was decided after a revision, here or in another tab."""
        since = request.query_params.get("since", "0")
        if not since.isdecimal() or len(since) > 15:
            return _refused(422, "'since' is a revision")
        entries = self._store.latest(since=int(since))
        return JSONResponse({"entries": [entry_values(entry) for entry in self._known(entries)]})

    def history(self, request: Request) -> Response:
        """All decisions about a finding."""
        entries = self._store.history(request.query_params.get("id", ""))
        return JSONResponse({"entries": [entry_values(entry) for entry in entries]})

    async def decide(self, request: Request) -> Response:
        """Take a decision; the answer comes when it is on the disk."""
        if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return _refused(415, "a decision comes as application/json")
        body = bytearray()
        async for chunk in request.stream():
            body += chunk
            if len(body) > _LONGEST_BODY:
                return _refused(413, "the request is too long")
        return await run_in_threadpool(self._decide, bytes(body))

    def _decide(self, body: bytes) -> Response:
        try:
            identity, status, comment, after = _read_decision(body)
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            return _refused(422, f"no decision: {error}")
        finding = self._run.by_id.get(identity)
        if finding is None:
            return _refused(404, "there is no such finding")
        try:
            entry = self._store.decide(finding.decided(status, comment), after=after)
        except ConflictError as conflict:
            current = None if conflict.current is None else entry_values(conflict.current)
            text = "it was decided in another tab meanwhile"
            return JSONResponse({"error": text, "entry": current}, status_code=409)
        return JSONResponse({"entry": entry_values(entry)})

    def _as_it_stands(self, values: dict[str, Any], entries: dict[str, Entry]) -> dict[str, Any]:
        """Return a finding with the last decision about it, or what an earlier review said."""
        entry = entries.get(values["id"])
        if entry is None:
            return {**values, "comment": "", "revision": 0}
        return {
            **values,
            "status": str(entry.decision.status),
            "comment": entry.decision.comment,
            "revision": entry.revision,
        }

    def _known(self, entries: list[Entry]) -> list[Entry]:
        return [entry for entry in entries if entry.decision.finding_id in self._run.by_id]


def _read_decision(body: bytes) -> tuple[str, Status, str, int]:
    values = json.loads(body)
    identity, comment, after = values["id"], values["comment"], values["after"]
    if not isinstance(identity, str) or not isinstance(comment, str):
        raise TypeError("id and comment are texts")
    if len(comment) > _LONGEST_COMMENT:
        raise ValueError(f"a comment has at most {_LONGEST_COMMENT} characters")
    if type(after) is not int or not 0 <= after < 2**63:
        raise TypeError("after is a revision")
    comment.encode()  # half of a surrogate pair is no text
    return identity, Status(values["status"]), comment, after


def _map_values(run: ReviewRun) -> dict[str, Any]:
    return {
        "lines": [
            {
                "name": f"way {line.line_id}",
                "kind": line.kind,
                "type": line.type,
                "colour": line.colour,
                "painted": line.painted,
                "points": line.points_m,
            }
            for line in run.map.lines
        ],
        "paths": run.map.paths,
    }


def _refused(code: int, text: str) -> Response:
    return JSONResponse({"error": text}, status_code=code)

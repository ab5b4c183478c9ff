"""`percept map review` on the command line: how it ends, what it refuses, what it exports."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
from made_review_run import make_review_run
from review_process import COMMAND, review_server
from typer.testing import CliRunner, Result

from percept.cli.app import app
from percept.cli.run_folder import describe_input
from percept.core.map_findings import Status
from percept.review import ReviewStore, read_run

Run = Callable[..., Result]


@pytest.fixture
def call() -> Run:
    """Runs a command as the shell would."""

    def invoke(*arguments: object) -> Result:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return invoke


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return make_review_run(tmp_path / "run", findings=5, pictures=False)


def test_ctrl_c_ends_well_and_says_how_before(run: Path) -> None:
    before = {path: path.stat() for path in run.rglob("*")}
    with review_server(run) as (address, process):
        assert address.startswith("http://127.0.0.1:")
        assert "/?token=" in address
        assert process.stderr is not None
        said = process.stderr.readline()
        assert "Ctrl-C" in said
        assert "review.sqlite" in said
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == ("", "")
        assert process.returncode == 0
    after = {path: path.stat() for path in run.rglob("*") if path.name != "review.sqlite"}
    assert {p: (s.st_mtime_ns, s.st_size) for p, s in after.items() if p.is_file()} == {
        p: (s.st_mtime_ns, s.st_size) for p, s in before.items() if p.is_file()
    }


def _fails(*arguments: object) -> tuple[int, str]:
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    return done.returncode, done.stderr


def test_what_cannot_be_reviewed_is_one_line(run: Path, tmp_path: Path) -> None:
    code, said = _fails(tmp_path, "--no-browser")
    assert (code, "no finished validation of a map" in said) == (3, True)
    assert not list(tmp_path.glob("review.sqlite*"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        code, said = _fails(run, "--no-browser", "--port", taken.getsockname()[1])
    assert (code, "cannot be used" in said, "--port" in said) == (2, True, True)
    (run / "review.sqlite").write_bytes(b"SQLite format 3\0 and then nonsense" * 100)
    code, said = _fails(run, "--no-browser")
    assert (code, "is damaged" in said, "copy" in said) == (3, True, True)


_MAP = """<osm version="0.6">
<node id="1" lat="43.78" lon="-79.46"/><node id="2" lat="43.78" lon="-79.45"/>
<way id="103"><nd ref="2"/><nd ref="1"/><tag k="color" v="white"/><tag k="by" v="a &amp; b"/></way>
</osm>"""


@pytest.fixture
def confirmed(tmp_path: Path) -> Path:
    """A run with a whole way of another colour and others, five of them confirmed."""
    colour = {"kind": "colour", "map_element_id": 103, "along_m": 0.0, "length_m": 1600.0}
    row = {**colour, "id": "c", "observed": "yellow over 1600 m", "confidence": 1.0}
    run = make_review_run(tmp_path / "run", findings=30, pictures=False, rows=[row])
    (tmp_path / "map.osm").write_text(_MAP)
    inputs = [describe_input(path) for path in (run / "map_lines.json", tmp_path / "map.osm")]
    (run / "run.json").write_text(json.dumps({"inputs": inputs}))
    with ReviewStore(run / "review.sqlite") as store:
        known = read_run(run)
        others = [finding for finding in known.findings if finding.finding_id != "c"]
        for finding in [known.by_id["c"], *others[:4]]:
            store.decide(finding.decided(Status.CONFIRMED, "seen"))
        store.decide(others[4].decided(Status.REJECTED, ""))
    return run


def test_decisions_are_exported(call: Run, confirmed: Path, tmp_path: Path) -> None:
    out = tmp_path / "decided"
    done = call("map", "review", confirmed, "--export", out)
    assert done.exit_code == 0, done.output
    assert "6 of 30 are decided" in done.stdout
    assert "4 confirmed findings; 1 without a place on earth" in done.stdout
    assert "1 way gets other tags" in done.stdout
    assert "left to an editor" in done.stdout
    names = ["confirmed.osc", "confirmed.osm", "decisions.csv", "decisions.json"]
    assert sorted(path.name for path in out.iterdir()) == names
    (way,) = Xml.parse(out / "confirmed.osc").getroot().findall("./modify/way")  # noqa: S314
    assert [nd.get("ref") for nd in way.findall("nd")] == ["2", "1"]
    tags = {tag.get("k"): tag.get("v") for tag in way.findall("tag")}
    assert tags == {"color": "yellow", "by": "a & b"}
    again = call("map", "review", confirmed, "--export", out)
    assert (again.exit_code, "--force" in again.stderr) == (2, True)
    assert call("map", "review", confirmed, "--export", out, "--force").exit_code == 0
    assert {path.name for path in confirmed.glob("*sqlite*")} == {"review.sqlite"}


def test_changes_are_made_to_the_map_that_was_validated(
    call: Run, confirmed: Path, tmp_path: Path
) -> None:
    asked = ("map", "review", confirmed, "--export", tmp_path / "decided")
    (tmp_path / "map.osm").rename(tmp_path / "old.osm")
    for content, said in (
        (None, "is not there"),
        (_MAP + "\n", "was changed"),
        ("<osm/>", "changed"),
    ):
        if content is not None:
            (tmp_path / "map.osm").write_text(content)
        done = call(*asked)
        assert (done.exit_code, said in done.stderr, "--map" in done.stderr) == (3, True, True)
    foreign = call(*asked, "--map", tmp_path / "map.osm")
    assert (foreign.exit_code, "has no way 103" in foreign.stderr) == (3, True)
    assert not (tmp_path / "decided").exists()
    assert call(*asked, "--map", tmp_path / "old.osm").exit_code == 0
    alone = call("map", "review", confirmed, "--map", tmp_path / "old.osm")
    assert (alone.exit_code, "--export" in alone.stderr) == (2, True)

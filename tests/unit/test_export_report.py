"""The report stands alone, says the verdict first, and takes nothing that it is given as code."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from percept.core.results import Verdict
from percept.export.report import (
    Paragraph,
    Picture,
    ReportContent,
    Section,
    Table,
    svg_picture,
    write_report,
)

_NASTY = '<script>alert(\'x\')</script> & "$title" onerror="y"'
_PNG = "data:image/png;base64,iVBORw0KGgo="


class _Page(HTMLParser):
    """Collects the elements, their attributes and the text of a page; checks that tags close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self._open or self._open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return "\n".join(word.strip() for word in self.words if word.strip())


def _content(text: str = "some text") -> ReportContent:
    return ReportContent(
        title=f"Title {text}",
        verdict=Verdict.DOUBTFUL,
        why=(f"why {text}",),
        advice=(f"advice {text}",),
        sections=(
            Section(
                f"section {text}",
                (
                    Paragraph(f"paragraph {text}"),
                    Picture(_PNG, f"alt {text}", f"caption {text}"),
                    svg_picture("<svg xmlns='http://www.w3.org/2000/svg'/>", "a drawing"),
                    Table(("name", f"header {text}"), ((f"cell {text}", "1,234.5"),), "numbers"),
                ),
            ),
        ),
        subtitle=f"subtitle {text}",
    )


def _written(tmp_path: Path, content: ReportContent) -> tuple[str, _Page]:
    path = tmp_path / "report.html"
    write_report(path, content)
    assert list(tmp_path.iterdir()) == [path]
    text = path.read_text(encoding="utf-8")
    return text, _Page(text)


def test_verdict_and_reasons_come_first(tmp_path: Path) -> None:
    _, page = _written(tmp_path, _content())
    places = [
        page.text.index(words)
        for words in ("Title some", "doubtful", "why some", "advice some", "section some")
    ]
    assert places == sorted(places)


def test_every_text_is_escaped(tmp_path: Path) -> None:
    text, page = _written(tmp_path, _content(_NASTY))
    assert "script" not in {tag for tag, _ in page.tags}
    assert not {name for _, attrs in page.tags for name in attrs if name.startswith("on")}
    for what in ("Title", "why", "advice", "section", "paragraph", "caption", "cell", "subtitle"):
        assert f"{what} {_NASTY}" in page.text, what
    assert [a["alt"] for tag, a in page.tags if tag == "img"] == [f"alt {_NASTY}", "a drawing"]
    assert "<script" not in text


def test_nothing_is_asked_from_outside(tmp_path: Path) -> None:
    text, page = _written(tmp_path, _content())
    policy = next(
        attrs["content"] for _, attrs in page.tags if "http-equiv" in attrs and attrs["content"]
    )
    assert "default-src 'none'" in policy
    links = [v for _, attrs in page.tags for n, v in attrs.items() if n in ("src", "href") and v]
    assert len(links) == 2
    assert all(link.startswith("data:image/") for link in links)
    assert not re.search(r"url\(|@import|https?://", text)


def test_pictures_stand_side_by_side(tmp_path: Path) -> None:
    text, page = _written(tmp_path, _content())
    assert next(attrs for tag, attrs in page.tags if tag == "div") == {"class": "pictures"}
    assert text.count("<figure>") == 2
    drawing = [attrs["src"] for tag, attrs in page.tags if tag == "img"][1]
    assert drawing is not None
    assert base64.b64decode(drawing.partition(",")[2]).startswith(b"<svg")


def test_only_columns_of_numbers_stand_right(tmp_path: Path) -> None:
    table = Table(("a", "b"), (("1,000", "x"), ("12 %", "3")))
    content = ReportContent("t", Verdict.GOOD, (), (), (Section("s", (table,)),))
    _, page = _written(tmp_path, content)
    assert [attrs.get("class") for tag, attrs in page.tags if tag == "td"] == [
        "number",
        None,
    ] * 2


def test_the_same_content_gives_the_same_bytes(tmp_path: Path) -> None:
    first, _ = _written(tmp_path, _content())
    assert _written(tmp_path, _content())[0] == first


def test_content_that_cannot_be_shown_is_a_bug() -> None:
    with pytest.raises(ValueError, match="1 cells for 2 columns"):
        Table(("a", "b"), (("only one",),))
    with pytest.raises(ValueError, match="data URIs"):
        Picture("https://example.org/picture.png", "fetched")

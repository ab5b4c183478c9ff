"""Reports that a person reads: one HTML file that needs nothing else and asks nobody.

The order is the same in every report: the verdict and why, what to do, then the evidence.
Every text is escaped, pictures are data URIs, and a content security policy forbids the file
scripts and requests.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from string import Template

from percept.core.results import Verdict

__all__ = [
    "Block",
    "Paragraph",
    "Picture",
    "ReportContent",
    "Section",
    "Table",
    "svg_picture",
    "write_report",
]

_VERDICT_MEANS = {
    Verdict.GOOD: "the result can be used",
    Verdict.DOUBTFUL: "look before you use the result",
    Verdict.BAD: "do not use the result",
    Verdict.AMBIGUOUS: "the data allow more than one result",
}
_PICTURE_STARTS = (
    "data:image/png;base64,",
    "data:image/jpeg;base64,",
    "data:image/svg+xml;base64,",
)


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph of plain text."""

    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table of plain texts; columns that hold only numbers are set right-aligned.

    Attributes:
        header: Name of each column, with its unit.
        rows: Cells, as many a row as there are columns.
        caption: What the table shows, or an empty text.

    Raises:
        ValueError: If a row has another number of cells than the header.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.header):
                raise ValueError(f"a table row has {len(row)} cells for {len(self.header)} columns")


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture inside the report.

    Attributes:
        data_uri: PNG, JPEG or SVG as a base64 data URI.
        alt: What is to be seen, for those who do not see it.
        caption: Text below it, or an empty text.

    Raises:
        ValueError: If the picture would have to be fetched from somewhere.
    """

    data_uri: str
    alt: str
    caption: str = ""

    def __post_init__(self) -> None:
        if not self.data_uri.startswith(_PICTURE_STARTS):
            raise ValueError("a report holds its pictures as base64 data URIs")


Block = Paragraph | Table | Picture


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a report; pictures that follow each other stand side by side."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class ReportContent:
    """What a report says.

    Attributes:
        title: What was done, to what.
        verdict: How far the result can be trusted.
        why: The reasons for the verdict, the weightiest first.
        advice: What to do about it, the most useful first.
        sections: The evidence.
        subtitle: When and with what, in one line.
    """

    title: str
    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    sections: tuple[Section, ...]
    subtitle: str = ""


def svg_picture(svg: str, alt: str, caption: str = "") -> Picture:
    """Return an SVG drawing as a picture; in an image element its scripts, if any, are dead."""
    data = base64.b64encode(svg.encode()).decode("ascii")
    return Picture(f"data:image/svg+xml;base64,{data}", alt, caption)


def write_report(path: Path, content: ReportContent) -> None:
    """Write a report as one HTML file, which gets its name when it is whole.

    Args:
        path: The file; an older one is replaced.
        content: What it says.
    """
    template = files("percept.export").joinpath("report_template.html").read_text("utf-8")
    page = Template(template).substitute(
        title=escape(content.title),
        subtitle=escape(content.subtitle),
        verdict=_verdict(content),
        sections="\n".join(_section(section) for section in content.sections),
    )
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.write_text(page, encoding="utf-8")
    unfinished.replace(path)


def _verdict(content: ReportContent) -> str:
    meaning = _VERDICT_MEANS[content.verdict]
    parts = [
        f'<section class="verdict {content.verdict.value}">',
        f"<p><strong>{content.verdict.value}</strong>: {meaning}</p>",
        _list("ul", content.why),
    ]
    if content.advice:
        parts += ["<h3>What to do</h3>", _list("ol", content.advice)]
    return "\n".join([*parts, "</section>"])


def _list(kind: str, texts: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<{kind}>{items}</{kind}>" if texts else ""


def _section(section: Section) -> str:
    blocks = "\n".join(_blocks(section.blocks))
    return f"<section>\n<h2>{escape(section.title)}</h2>\n{blocks}\n</section>"


def _blocks(blocks: Sequence[Block]) -> Iterator[str]:
    for kind, group in groupby(blocks, type):
        rendered = "\n".join(_block(block) for block in group)
        yield f'<div class="pictures">\n{rendered}\n</div>' if kind is Picture else rendered


def _block(block: Block) -> str:
    match block:
        case Paragraph(text):
            return f"<p>{escape(text)}</p>"
        case Picture(data_uri, alt, caption):
            image = f'<img src="{escape(data_uri)}" alt="{escape(alt)}">'
            return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"
        case Table():
            return _table(block)


def _table(table: Table) -> str:
    right = [
        bool(table.rows) and all(_is_number(row[column]) for row in table.rows)
        for column in range(len(table.header))
    ]
    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    head = _row("th", table.header, right)
    body = "".join(_row("td", row, right) for row in table.rows)
    inner = f"{caption}<thead>{head}</thead><tbody>{body}</tbody>"
    return f'<div class="scroll"><table>{inner}</table></div>'


def _row(tag: str, cells: Sequence[str], right: Sequence[bool]) -> str:
    texts = (
        f"<{tag}{' class=number' if number else ''}>{escape(cell)}</{tag}>"
        for cell, number in zip(cells, right, strict=True)
    )
    return f"<tr>{''.join(texts)}</tr>"


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().rstrip("%").replace(",", "") or "0")
    except ValueError:
        return False
    return True

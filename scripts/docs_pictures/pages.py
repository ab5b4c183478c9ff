"""Pages of the documentation: what stands between marks, and the commands that they show."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

__all__ = ["ROOT", "fill_in", "follow", "follow_all", "limits_table", "run"]

ROOT = Path(__file__).resolve().parents[2]


def fill_in(page: Path, name: str, lines: Iterable[str], language: str = "text") -> None:
    """Put lines between the marks of that name in a page, as code unless there is no language."""
    text = page.read_text(encoding="utf-8")
    begin, end = f"<!-- made by scripts/docs-pictures: {name} -->\n", "<!-- end -->"
    before, mark, rest = text.partition(begin)
    if not mark or end not in rest:
        raise SystemExit(f"{page.name} has no place for '{name}'")
    fence = (f"```{language}", "```") if language else ("", "")
    block = "\n".join((fence[0], *(line.rstrip() for line in lines), fence[1], ""))
    page.write_text(before + mark + block + rest[rest.index(end) :], encoding="utf-8")
    print(f"{page.name}: {name}")


def limits_table(family: type) -> Iterator[str]:
    """Yield the rows of a table of limits, each with its reason from the docstring."""
    yield from ("| limit | value | why |", "|---|---|---|")
    _, _, described = (family.__doc__ or "").partition("Attributes:\n")
    # An attribute begins eight columns in; what goes on is farther to the right.
    for entry in re.split(r"\n(?= {8}\w+:)", described.rstrip()):
        name, _, reason = " ".join(entry.split()).partition(": ")
        yield f"| `{name}` | {getattr(family(), name):g} | {reason} |"


def follow(page: Path, folder: Path, wanted: tuple[str, ...]) -> dict[str, list[str]]:
    """Run a page's commands that begin so in a new folder; return what each prints, by line."""
    folder.mkdir()
    blocks = re.findall(r"^```bash\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S)
    lines = "".join(b for b in blocks if not b.startswith("cat ")).replace("\\\n", " ").splitlines()
    return {line: run(line, folder) for line in lines if line.startswith(wanted)}


def follow_all(page: Path, folder: Path) -> dict[str, list[str]]:
    """Do all that a page shows in a new folder; return what each command prints, by line."""
    folder.mkdir()
    printed: dict[str, list[str]] = {}
    text = page.read_text(encoding="utf-8")
    for language, block in re.findall(r"^```(bash|python)\n(.*?)^```$", text, re.M | re.S):
        if language == "python":
            run(f"{sys.executable} - <<'END'\n{block}END\n", folder)
            continue
        for command in block.splitlines():
            printed[command] = run(command, folder)
    return printed


def run(command: str, folder: Path) -> list[str]:
    """Run a command in a folder and return the lines that it prints."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(  # noqa: S603 - our own commands
        ["/bin/sh", "-e", "-c", command], cwd=folder, env=environment, capture_output=True,
        text=True,
    )  # fmt: skip
    if done.returncode not in (0, 4):
        raise SystemExit(f"{command}: {done.stderr}")
    return done.stdout.splitlines()

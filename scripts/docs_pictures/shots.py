"""Pictures for the documentation: written small, taken out of reports, and of whole pages."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from docs_pictures.pages import ROOT

__all__ = ["Picture", "browser_for", "find", "photograph", "pictures_of", "row", "save"]

PICTURES = ROOT / "docs" / "pictures"
LARGEST_BYTES = 300_000

Picture = NDArray[np.uint8]


def photograph(page: Path, name: str, *, width: int, height: int) -> None:
    """Take a picture of the top of an HTML page."""
    browser = browser_for(name)
    if browser is None:
        return
    shot = page.with_suffix(".png")
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
    subprocess.run(  # noqa: S603 - the browser was looked up in PATH, and the page is ours
        [
            browser, *options, f"--window-size={width},{height}", f"--screenshot={shot}",
            f"--user-data-dir={page.parent / 'browser'}", page.resolve().as_uri(),
        ],
        check=True, capture_output=True,
    )  # fmt: skip
    picture = cv2.imread(str(shot))
    if picture is None:
        raise SystemExit(f"{browser} made no picture of {page.name}")
    save(name, picture)


def browser_for(name: str) -> str | None:
    """Return the browser that takes a picture; None, and say so, where there is none."""
    browser = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    if browser is None:
        print(f"{name}: left as it is, there is no Chromium", file=sys.stderr)
    return browser


def save(name: str, picture: Picture, method: Image.Quantize = Image.Quantize.MAXCOVERAGE) -> None:
    """Write a PNG with a palette; the default covers rare colours, which tell classes apart."""
    path = PICTURES / name
    rgb = Image.fromarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    rgb.quantize(256, method=method, dither=Image.Dither.NONE).save(path, optimize=True)
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        raise SystemExit(f"{name} has {size} bytes; make it smaller")
    print(f"{name}: {size / 1000:.0f} kB")


def pictures_of(run: Path) -> dict[str, Picture]:
    """Return the pictures of a run's report by what they are said to show, in their order."""
    page = (run / "report.html").read_text(encoding="utf-8")
    found: dict[str, Picture] = {}
    for data, alt in re.findall(r'src="data:image/\w+;base64,([^"]+)" *alt="([^"]*)"', page):
        pixels = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
        if pixels is not None:
            found.setdefault(alt, pixels.astype(np.uint8))
    return found


def find(pictures: dict[str, Picture], begins: str) -> Picture:
    """Return the first picture whose description begins so."""
    for name, picture in pictures.items():
        if name.startswith(begins):
            return picture
    raise SystemExit(f"the report has no picture '{begins}'")


def row(pictures: Sequence[Picture], height_px: int) -> Picture:
    """Put pictures side by side, all of one height."""
    parts: list[Picture] = []
    for picture in pictures:
        width_px = round(picture.shape[1] * height_px / picture.shape[0])
        scaled = cv2.resize(picture, (width_px, height_px), interpolation=cv2.INTER_AREA)
        parts += [scaled.astype(np.uint8), np.full((height_px, 8, 3), 255, np.uint8)]
    return np.hstack(parts[:-1])

"""Names of files made of names that come with a log, which may be anything."""

from __future__ import annotations

import hashlib
import re
import unicodedata

__all__ = ["safe_name"]

_LONGEST = 40
_UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")


def safe_name(text: str) -> str:
    """Return a name of letters, digits, `-`, `_` and `.` that no other text has.

    A text of just these, short and without a `.` at its ends, is returned as it is. Of any other
    what can be kept is kept, and a few digits of its SHA-256 follow, so that `/a/b` and `a-b`
    stay apart and nothing can lead out of a folder.
    """
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    kept = _UNSAFE.sub("-", ascii_text).strip("-.")[:_LONGEST].strip("-.")
    if text and kept == text:
        return text
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:6]
    return f"{kept}-{digest}" if kept else digest

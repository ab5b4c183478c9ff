"""Text that comes back from XML as it went in."""

from __future__ import annotations

import re

__all__ = ["xml_text"]

# What XML 1.0 has no way to write (section 2.2), and the white space that its readers change into
# spaces or other line ends (sections 2.11 and 3.3.3).
_NOT_IN_XML = re.compile("[\x00-\x1f\x7f\ud800-\udfff\ufffe\uffff]")


def xml_text(text: str) -> str:
    r"""Return a text with its control characters spelled out: a bell becomes `\u0007`.

    Markup is not escaped; that is left to who writes the document. Any other text is returned as
    it is.
    """
    return _NOT_IN_XML.sub(lambda found: f"\\u{ord(found[0]):04x}", text)

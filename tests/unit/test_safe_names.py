"""Names of files made of names that come with a log."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from percept.datasets.labelling.names import safe_name


@given(st.text())
def test_any_text_becomes_a_name_that_leads_nowhere(text: str) -> None:
    name = safe_name(text)
    assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", name)
    assert not name.endswith(".")
    assert len(name) <= 47


@given(st.lists(st.text(max_size=6), unique=True, max_size=20))
def test_texts_that_differ_have_names_that_differ(texts: list[str]) -> None:
    assert len({safe_name(text).lower() for text in texts}) >= len({t.lower() for t in texts})


def test_plain_names_stay() -> None:
    assert safe_name("front") == "front"
    assert safe_name("../../etc").startswith("etc-")
    assert safe_name("/a/b") != safe_name("a-b") == "a-b"

"""Options that are repeated as `NAME=VALUE`."""

from __future__ import annotations

import pytest

from percept.cli.options import named_values
from percept.core.errors import UsageError


def test_each_entry_is_split_at_its_first_equals_sign() -> None:
    assert named_values(["/top=10", "/a=b=c"], "--rate") == {"/top": "10", "/a": "b=c"}


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        (["/top"], "--rate '/top' is not of the form NAME=VALUE"),
        (["=10"], "--rate '=10' is not of the form NAME=VALUE"),
        (["/top="], "--rate '/top=' is not of the form NAME=VALUE"),
        (["/top=10", "/top=20"], "--rate names '/top' twice"),
    ],
)
def test_what_is_no_pair_or_comes_twice_is_refused(entries: list[str], text: str) -> None:
    with pytest.raises(UsageError) as caught:
        named_values(entries, "--rate")
    assert str(caught.value) == text

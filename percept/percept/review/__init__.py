"""The local page on which a person decides what map and road disagree about.

`percept.review.app` makes the page and `percept.review.server` shows it; both import a web
framework, and this module does not, so that the next validation reads decisions without it.
"""

from __future__ import annotations

from percept.review.run import Finding, ReviewRun, read_run
from percept.review.store import ReviewStore, read_decisions

__all__ = ["Finding", "ReviewRun", "ReviewStore", "read_decisions", "read_run"]

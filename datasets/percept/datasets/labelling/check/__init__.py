"""What is wrong with a data set in a folder: a prepared one, or one of others."""

from __future__ import annotations

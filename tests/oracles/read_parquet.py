"""Prints the rows of tables that are read without Arrow: `read_parquet.py FILE...`."""

from __future__ import annotations

import json
import sys

import pandas

if __name__ == "__main__":
    tables = [pandas.read_parquet(file, engine="fastparquet") for file in sys.argv[1:]]
    json.dump(
        [json.loads(table.to_json(orient="records", double_precision=15)) for table in tables],
        sys.stdout,
    )

"""Prints the boxes that datumaro reads: `read_datumaro.py FORMAT FOLDER...`."""

from __future__ import annotations

import json
import sys
from typing import Any

import datumaro


def _read(folder: str, name: str) -> list[dict[str, Any]]:
    dataset = datumaro.Dataset.import_from(folder, name)
    labels = [one.name for one in dataset.categories()[datumaro.AnnotationType.label]]
    return [_item(item, labels) for item in dataset]


def _item(item: datumaro.DatasetItem, labels: list[str]) -> dict[str, Any]:
    pixels = None if item.media is None else item.media.data
    return {
        "name": item.id,
        "split": item.subset,
        "file": getattr(item.media, "path", None),
        "size": None if pixels is None else [pixels.shape[1], pixels.shape[0]],
        "boxes": [
            {"label": labels[one.label], "box": one.points, "id": one.id, **one.attributes}
            for one in item.annotations
        ],
    }


if __name__ == "__main__":
    json.dump([_read(folder, sys.argv[1]) for folder in sys.argv[2:]], sys.stdout)

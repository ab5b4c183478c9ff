"""Prints what Label Studio's own library reads in tasks: `read_label_studio.py FOLDER`.

It validates each prediction against the labelling config, and then turns predictions into COCO as
if a person had accepted them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from label_studio_sdk.converter import Converter
from label_studio_sdk.label_interface import LabelInterface


def _read(folder: Path) -> dict[str, Any]:
    config = (folder / "config.xml").read_text("utf-8")
    tasks = json.loads((folder / "tasks.json").read_text("utf-8"))
    interface = LabelInterface(config)
    errors = [
        error
        for task in tasks
        for prediction in task["predictions"]
        for error in interface.validate_prediction(prediction, return_errors=True)
    ]
    for number, task in enumerate(tasks):
        task |= {"id": number, "annotations": task.pop("predictions")}
    return {"errors": errors, "tasks": len(tasks), "coco": _as_coco(config, tasks, folder)}


def _as_coco(config: str, tasks: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    with TemporaryDirectory() as work:
        accepted = Path(work) / "tasks.json"
        accepted.write_text(json.dumps(tasks), "utf-8")
        converter = Converter(config, str(folder), download_resources=False)
        converter.convert_to_coco(str(accepted), work, is_dir=False)
        content: dict[str, Any] = json.loads((Path(work) / "result.json").read_text("utf-8"))
        return content


if __name__ == "__main__":
    json.dump(_read(Path(sys.argv[1])), sys.stdout)

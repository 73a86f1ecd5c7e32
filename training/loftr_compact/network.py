"""The network of `loftr-compact`, which is kornia's LoFTR, and its training losses."""

from __future__ import annotations

import copy
from typing import Any

import torch
from kornia.feature.loftr import loftr
from salframe_keypoints.loftr_compact import ARCHITECTURE, FINE_STRIDE_PX, STRIDE_PX, WINDOW
from torch.nn import functional

from salframe.framework.config import merge

FINE_RADIUS_PX = WINDOW // 2 * FINE_STRIDE_PX
MAX_CELLS = 320 // STRIDE_PX, 240 // STRIDE_PX
"""Width and height of the coarse grid at run time."""

_RESIDUAL_GAIN = 0.2


def build() -> loftr.LoFTR:
    """Return the network with random weights from torch's seed.

    Transformer layers are initialised as small corrections of their input, so that backbone and matching learn from the
    first step on.
    """
    network = loftr.LoFTR(pretrained=None, config=merge(copy.deepcopy(loftr.default_cfg), ARCHITECTURE))
    for layer in (*network.loftr_coarse.layers, *network.loftr_fine.layers):
        torch.nn.init.constant_(layer.norm2.weight, _RESIDUAL_GAIN)
    return network.to(memory_format=torch.channels_last)


def losses(
    network: loftr.LoFTR, batch: dict[str, torch.Tensor], fine_matches: int, generator: torch.Generator
) -> dict[str, torch.Tensor]:
    """Compute the losses of a batch of pairs: coarse and fine loss (LoFTR section 3.6), and the coarse loss of the
    backbone's features.

    Args:
        network: The network.
        batch: `images` (B, 2, 1, h, w) float32 in [0, 1]; `cells` (B, L) int64, the matching cell of the second view
            for each cell of the first, or -1; `offset_px` (B, L, 2) float32, from that cell to the true position.
        fine_matches: Maximum number of matches per pair for the fine loss.
        generator: Random generator.

    Returns:
        The losses "coarse", "backbone" and "fine", each a scalar.
    """
    count = len(batch["images"])
    with torch.autocast("cpu", torch.bfloat16):
        maps, fine = network.backbone(
            batch["images"].transpose(0, 1).flatten(0, 1).contiguous(memory_format=torch.channels_last)
        )
        raw, encoded = maps.float(), _encode(network, maps.float(), generator)
        tokens = [
            part.flatten(2).transpose(1, 2).contiguous()
            for part in (raw[:count], raw[count:], encoded[:count], encoded[count:])
        ]
        first, second = (part.float() for part in network.loftr_coarse(*tokens[2:]))
    pair, i = torch.nonzero(batch["cells"] >= 0, as_tuple=True)
    j = batch["cells"][pair, i]
    if not len(pair):
        raise ValueError(
            "the image pairs of a training batch have no true match, expected at least one: use pairs that overlap"
        )
    chosen = torch.randperm(len(pair), generator=generator)[: fine_matches * count]
    expected = _fine(network, fine.float(), first, second, (pair[chosen], i[chosen], j[chosen]), count)
    true = batch["offset_px"][pair[chosen], i[chosen]] / FINE_RADIUS_PX
    return {
        "coarse": _coarse_loss(first, second, pair, i, j),
        "backbone": _coarse_loss(*tokens[:2], pair, i, j),
        "fine": _fine_loss(expected, true),
    }


def _encode(network: loftr.LoFTR, maps: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """Return the maps (2 B, C, h, w) with position encodings at a random offset, as if the images were crops of larger
    ones."""
    _, _, height, width = maps.shape
    shifts = torch.rand(2, 2, generator=generator)
    parts = []
    for part, (down, right) in zip(maps.chunk(2), shifts.tolist(), strict=True):
        row, column = int(down * (MAX_CELLS[1] - height + 1)), int(right * (MAX_CELLS[0] - width + 1))
        parts.append(part + network.pos_encoding.pe[:, :, row : row + height, column : column + width])
    return torch.cat(parts)


def _coarse_loss(
    first: torch.Tensor, second: torch.Tensor, pair: torch.Tensor, i: torch.Tensor, j: torch.Tensor
) -> torch.Tensor:
    """Return the focal loss (alpha 0.25, gamma 2) of the dual-softmax confidence of true matches, temperature 0.1."""
    similarity = torch.einsum("nlc,nsc->nls", first, second) / (first.shape[2] * 0.1)
    log_confidence = (functional.log_softmax(similarity, 1) + functional.log_softmax(similarity, 2))[pair, i, j]
    return (-0.25 * (1 - log_confidence.exp()) ** 2 * log_confidence).mean()


def _fine(
    network: loftr.LoFTR, fine: torch.Tensor, first: torch.Tensor, second: torch.Tensor, matches: tuple, count: int
) -> torch.Tensor:
    """Return (M, 3): the expected offset in units of the window's radius, and its standard deviation."""
    pair, i, j = matches
    data: dict[str, Any] = {"b_ids": pair, "i_ids": i, "j_ids": j, "stride_c": STRIDE_PX, "stride_f": FINE_STRIDE_PX}
    data |= {
        "mkpts0_c": torch.zeros(len(pair), 2),
        "mkpts1_c": torch.zeros(len(pair), 2),
        "mconf": torch.zeros(len(pair)),
    }
    windows = network.fine_preprocess(fine[:count], fine[count:], first, second, data)
    network.fine_matching(*network.loftr_fine(*windows), data)
    return data["expec_f"]


def _fine_loss(expected: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Return the squared error, weighted by the inverse deviation. The deviation is detached, so it has no gradient."""
    inside = true.abs().amax(1) < 1
    weight = 1 / expected[:, 2].detach().clamp(min=1e-10)
    error = ((expected[:, :2] - true) ** 2).sum(1) * weight / weight.mean()
    return error[inside].sum() / inside.sum().clamp(min=1)

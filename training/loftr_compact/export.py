"""Export of the trained network to the ONNX files of `loftr-compact`, and to a state for kornia's module."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path
from typing import Any

import torch
from kornia.feature.loftr import loftr
from salframe_keypoints.loftr_compact import FILES, FINE_STRIDE_PX, MAX_PX, STATE, STRIDE_PX
from torch import Tensor, nn

from salframe.framework.files.writing import atomic_path

OPSET = 18


class _FeatureExtractor(nn.Module):
    """Maps an image (1, 1, h, w) to position-encoded tokens (1, L, C) of the coarse grid, and a fine map
    (1, D, h / 2, w / 2)."""

    def __init__(self, network: loftr.LoFTR) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        coarse, fine = self.network.backbone(image)
        return self.network.pos_encoding(coarse).flatten(2).transpose(1, 2), fine


class _Coarse(nn.Module):
    """Maps tokens of two images to dual-softmax confidence (1, L, S) and attended tokens (1, L, C), (1, S, C)."""

    def __init__(self, network: loftr.LoFTR) -> None:
        super().__init__()
        self.transformer, self.temperature = network.loftr_coarse, network.coarse_matching.temperature

    def forward(self, first: Tensor, second: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        first, second = self.transformer(first, second)
        similarity = first @ second.transpose(1, 2) / (first.shape[2] * self.temperature)
        return similarity.softmax(1) * similarity.softmax(2), first, second


class _Fine(nn.Module):
    """Maps the fine windows (M, 25, D) and attended tokens (M, C) of both sides of matches to offsets (M, 2), in units
    of the window's radius."""

    def __init__(self, network: loftr.LoFTR) -> None:
        super().__init__()
        self.network = network

    def forward(self, first: Tensor, second: Tensor, first_token: Tensor, second_token: Tensor) -> Tensor:
        merge, context = self.network.fine_preprocess.merge_feat, self.network.fine_preprocess.down_proj
        windows = [
            merge(torch.cat([window, context(token)[:, None].expand(-1, window.shape[1], -1)], 2))
            for window, token in ((first, first_token), (second, second_token))
        ]
        data: dict[str, Any] = {"stride_f": FINE_STRIDE_PX, "b_ids": None, "mconf": first[:, 0, 0]}
        data["mkpts0_c"] = data["mkpts1_c"] = torch.zeros_like(first[:, 0, :2])
        self.network.fine_matching(*self.network.loftr_fine(*windows), data)
        return data["expec_f"][:, :2]


def export(network: loftr.LoFTR, folder: Path) -> None:
    """Write the files to a folder.

    Image sides must be multiples of 8 up to MAX_PX, the size of the exported position encoding.
    """
    network = copy.deepcopy(network).eval().to(memory_format=torch.contiguous_format)
    cells = MAX_PX // STRIDE_PX
    network.pos_encoding.pe = network.pos_encoding.pe[:, :, :cells, :cells].clone()
    dims, window = network.config["resnetfpn"]["block_dims"], network.config["fine_window_size"] ** 2
    tokens, points = torch.rand(1, 300, dims[-1]), torch.rand(40, dims[-1])
    windows = torch.rand(40, window, dims[0])
    parts: list[tuple[nn.Module, tuple[Tensor, ...], dict[str, dict[int, str]], list[str]]] = [
        (
            _FeatureExtractor(network),
            (torch.rand(1, 1, 120, 160),),
            {"image": {2: "height", 3: "width"}},
            ["tokens", "fine"],
        ),
        (
            _Coarse(network),
            (tokens, torch.rand_like(tokens)),
            {"first": {1: "cells0"}, "second": {1: "cells1"}},
            ["confidence", "tokens0", "tokens1"],
        ),
        (
            _Fine(network),
            (windows, torch.rand_like(windows), points, torch.rand_like(points)),
            {name: {0: "matches"} for name in ("first", "second", "first_token", "second_token")},
            ["offset"],
        ),
    ]
    for file, (module, example, axes, outputs) in zip(FILES, parts, strict=True):
        with atomic_path(folder / file) as temporary, warnings.catch_warnings():
            # The warnings are about branches on sizes, which are equal for all views, and about the old exporter.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                module.eval(),
                example,
                temporary,
                input_names=list(axes),
                output_names=outputs,
                dynamic_axes=axes,
                opset_version=OPSET,
                dynamo=False,
            )
    with atomic_path(folder / STATE) as temporary:
        torch.save(network.state_dict(), temporary)

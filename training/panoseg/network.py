"""The network in torch, for training and export: EfficientNet-Lite0 and a light pyramid, both closed at the panorama's
seam."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from salframe_panoseg.classes import CHANNELS
from torch import Tensor, nn
from torch.nn import functional

from salframe.framework.errors import WeightsMissing

LITE0 = (
    (1, 3, 1, 1, 32, 16),
    (2, 3, 2, 6, 16, 24),
    (2, 5, 2, 6, 24, 40),
    (3, 3, 2, 6, 40, 80),
    (3, 5, 1, 6, 80, 112),
    (4, 5, 2, 6, 112, 192),
    (1, 3, 1, 6, 192, 320),
)
"""EfficientNet-Lite0: repeats, kernel, stride, expansion, channels in and out of each stage (Tan and Le 2019; SE and
swish left out)."""
TAPS = {0: 16, 2: 24, 4: 40, 10: 112, 15: 320}
"""Blocks whose outputs the pyramid takes, and their channels: strides 2, 4, 8, 16, 32."""
WIDTH = 64


class Closed(torch.autograd.Function):
    """`closed` with its gradient in one pass: those of its slices, one after the other, make a training step 1.4 times
    as long."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, before: int, after: int) -> Tensor:
        ctx.padding = before, after
        return closed(image, before, after)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        before, after = ctx.padding
        rows = gradients[0][:, :, before:-after]
        gradient = rows[..., before:-after].clone()
        gradient[..., :after] += rows[..., -after:]
        if before:
            gradient[..., -before:] += rows[..., :before]
        return gradient, None, None


def closed(image: Tensor, before: int, after: int) -> Tensor:
    """(..., H, W) -> (..., H + before + after, W + before + after) by rows of zeros and columns of the other side;
    before >= 0, after >= 1."""
    image = torch.cat([image[..., image.shape[-1] - before :], image, image[..., :after]], -1)
    return functional.pad(image, (0, 0, before, after))


class SeamConv(nn.Conv2d):
    """A convolution that pads as TensorFlow's SAME does, but columns with those of the other side."""

    def forward(self, image: Tensor) -> Tensor:
        kernel, stride = self.kernel_size[0], self.stride[0]
        total = kernel - stride if kernel > stride else 0
        if total:
            pad = Closed.apply if torch.is_grad_enabled() else closed
            image = pad(image, total // 2, total - total // 2)
        return self._conv_forward(image, self.weight, self.bias)


def normalised(conv: nn.Conv2d) -> nn.BatchNorm2d:
    """The batch normalisation after a convolution, with EfficientNet's constants."""
    return nn.BatchNorm2d(conv.out_channels, eps=1e-3, momentum=0.01)


class MobileBlock(nn.Module):
    """Inverted bottleneck (Sandler et al. 2018); attributes are named as in the published checkpoint."""

    def __init__(self, kernel: int, stride: int, expansion: int, inputs: int, outputs: int) -> None:
        super().__init__()
        inner = inputs * expansion
        if expansion > 1:
            self._expand_conv = SeamConv(inputs, inner, 1, bias=False)
            self._bn0 = normalised(self._expand_conv)
        self._depthwise_conv = SeamConv(inner, inner, kernel, stride, groups=inner, bias=False)
        self._bn1 = normalised(self._depthwise_conv)
        self._project_conv = SeamConv(inner, outputs, 1, bias=False)
        self._bn2 = normalised(self._project_conv)
        self._residual = stride == 1 and inputs == outputs

    def forward(self, image: Tensor) -> Tensor:
        found = image
        if hasattr(self, "_expand_conv"):
            found = functional.relu6(self._bn0(self._expand_conv(found)))
        found = functional.relu6(self._bn1(self._depthwise_conv(found)))
        found = self._bn2(self._project_conv(found))
        return found + image if self._residual else found


class Separable(nn.Sequential):
    """A depthwise convolution and a pointwise one, each normalised."""

    def __init__(self, channels: int) -> None:
        depthwise = SeamConv(channels, channels, 3, groups=channels, bias=False)
        pointwise = SeamConv(channels, channels, 1, bias=False)
        super().__init__(depthwise, normalised(depthwise), pointwise, normalised(pointwise), nn.ReLU6())


class PanoSeg(nn.Module):
    """Classes and votes for every other pixel of a panorama.

    forward: (B, 6, H, 2H) float32 (`network_input`) -> logits (B, C, H/2, H) and votes (B, 3, H/2, H), metres from the
    pixel's point to the centre of its object, along the line of sight's direction on the floor, to its left, and up.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self._conv_stem = SeamConv(CHANNELS, 32, 3, 2, bias=False)
        self._bn0 = normalised(self._conv_stem)
        blocks = []
        for repeats, kernel, stride, expansion, inputs, outputs in LITE0:
            blocks.append(MobileBlock(kernel, stride, expansion, inputs, outputs))
            blocks += [MobileBlock(kernel, 1, expansion, outputs, outputs) for _ in range(repeats - 1)]
        self._blocks = nn.ModuleList(blocks)
        self.lateral = nn.ModuleList(SeamConv(channels, WIDTH, 1) for channels in TAPS.values())
        self.merge = nn.ModuleList(Separable(WIDTH) for _ in list(TAPS)[1:])
        self.classify = SeamConv(WIDTH, classes, 1)
        self.vote = nn.Sequential(Separable(WIDTH), SeamConv(WIDTH, 3, 1))

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        found = functional.relu6(self._bn0(self._conv_stem(image)))
        taps = []
        for number, block in enumerate(self._blocks):
            found = block(found)
            if number in TAPS:
                taps.append(found)
        levels = [lateral(tap) for lateral, tap in zip(self.lateral, taps, strict=True)]
        merged = levels.pop()
        for merge in self.merge:
            merged = merge(functional.interpolate(merged, scale_factor=2, mode="nearest") + levels.pop())
        return self.classify(merged), self.vote(merged)

    def load_encoder(self, state: Mapping[str, Any]) -> None:
        """Take ImageNet's EfficientNet-Lite0 over; the stem's new channels begin at 0. Raises WeightsMissing where the
        state does not fit."""
        own = self.state_dict()
        encoder = {name for name in own if name.startswith(("_conv_stem.", "_bn0.", "_blocks."))}
        absent = sorted(name for name in encoder if name not in state)
        if absent:
            raise WeightsMissing(
                f"the checkpoint is no EfficientNet-Lite0: {len(absent)} of {len(encoder)} tensors missing, "
                f"first {absent[0]}"
            )
        taken = {name: state[name] for name in encoder}
        stem = torch.zeros_like(own["_conv_stem.weight"])
        stem[:, :3] = taken["_conv_stem.weight"]
        self.load_state_dict(own | taken | {"_conv_stem.weight": stem})

"""The network in torch, for training and export: EfficientNet-Lite0 and a light feature pyramid, with convolutions that
wrap around the seam of the panorama."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from salframe_panoseg.classes import CHANNELS
from torch import Tensor, nn
from torch.nn import functional

from salframe.framework.errors import WeightsError

LITE0 = (
    (1, 3, 1, 1, 32, 16),
    (2, 3, 2, 6, 16, 24),
    (2, 5, 2, 6, 24, 40),
    (3, 3, 2, 6, 40, 80),
    (3, 5, 1, 6, 80, 112),
    (4, 5, 2, 6, 112, 192),
    (1, 3, 1, 6, 192, 320),
)
"""Repeats, kernel, stride, expansion, input and output channels of each stage of EfficientNet-Lite0 (Tan and Le 2019,
without SE and swish)."""
TAPS = {0: 16, 2: 24, 4: 40, 10: 112, 15: 320}
"""Blocks whose outputs are the input of the pyramid, and their channels, at strides 2, 4, 8, 16, 32."""
WIDTH = 64


class WrapPad(torch.autograd.Function):
    """`wrap_pad` with its gradient in one pass. Automatic gradients of its slices make a training step 1.4 times as
    long."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, before: int, after: int) -> Tensor:
        ctx.padding = before, after
        return wrap_pad(image, before, after)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        before, after = ctx.padding
        rows = gradients[0][:, :, before:-after]
        gradient = rows[..., before:-after].clone()
        gradient[..., :after] += rows[..., -after:]
        if before:
            gradient[..., -before:] += rows[..., :before]
        return gradient, None, None


def wrap_pad(image: Tensor, before: int, after: int) -> Tensor:
    """Pad an image (..., H, W) to (..., H + before + after, W + before + after) with rows of zeros and columns of the
    other side. Requires before >= 0 and after >= 1."""
    image = torch.cat([image[..., image.shape[-1] - before :], image, image[..., :after]], -1)
    return functional.pad(image, (0, 0, before, after))


class SeamConv(nn.Conv2d):
    """A convolution with TensorFlow's SAME padding, but circular in the horizontal direction: the left border is padded
    with columns from the right border of the panorama, and vice versa."""

    def forward(self, image: Tensor) -> Tensor:
        kernel, stride = self.kernel_size[0], self.stride[0]
        total = kernel - stride if kernel > stride else 0
        if total:
            pad = WrapPad.apply if torch.is_grad_enabled() else wrap_pad
            image = pad(image, total // 2, total - total // 2)
        return self._conv_forward(image, self.weight, self.bias)


def batch_norm_after(conv: nn.Conv2d) -> nn.BatchNorm2d:
    """Return a new batch normalisation layer for the output of a convolution, with the constants of EfficientNet."""
    return nn.BatchNorm2d(conv.out_channels, eps=1e-3, momentum=0.01)


class MobileBlock(nn.Module):
    """Inverted bottleneck (Sandler et al. 2018), with the attribute names of the published checkpoint."""

    def __init__(self, kernel: int, stride: int, expansion: int, inputs: int, outputs: int) -> None:
        super().__init__()
        inner = inputs * expansion
        if expansion > 1:
            self._expand_conv = SeamConv(inputs, inner, 1, bias=False)
            self._bn0 = batch_norm_after(self._expand_conv)
        self._depthwise_conv = SeamConv(inner, inner, kernel, stride, groups=inner, bias=False)
        self._bn1 = batch_norm_after(self._depthwise_conv)
        self._project_conv = SeamConv(inner, outputs, 1, bias=False)
        self._bn2 = batch_norm_after(self._project_conv)
        self._residual = stride == 1 and inputs == outputs

    def forward(self, image: Tensor) -> Tensor:
        features = image
        if hasattr(self, "_expand_conv"):
            features = functional.relu6(self._bn0(self._expand_conv(features)))
        features = functional.relu6(self._bn1(self._depthwise_conv(features)))
        features = self._bn2(self._project_conv(features))
        return features + image if self._residual else features


class Separable(nn.Sequential):
    """A depthwise and a pointwise convolution, each with batch normalisation."""

    def __init__(self, channels: int) -> None:
        depthwise = SeamConv(channels, channels, 3, groups=channels, bias=False)
        pointwise = SeamConv(channels, channels, 1, bias=False)
        super().__init__(depthwise, batch_norm_after(depthwise), pointwise, batch_norm_after(pointwise), nn.ReLU6())


class PanoSeg(nn.Module):
    """Predicts classes and votes at half the resolution of a panorama.

    `forward` maps a (B, 6, H, 2H) float32 input (`network_input`) to logits (B, C, H/2, H) and votes (B, 3, H/2, H). A
    vote is the offset, in metres, from the point of a pixel to the centre of its object: along the horizontal direction
    of the line of sight, to its left, and up.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self._conv_stem = SeamConv(CHANNELS, 32, 3, 2, bias=False)
        self._bn0 = batch_norm_after(self._conv_stem)
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
        features = functional.relu6(self._bn0(self._conv_stem(image)))
        taps = []
        for number, block in enumerate(self._blocks):
            features = block(features)
            if number in TAPS:
                taps.append(features)
        levels = [lateral(tap) for lateral, tap in zip(self.lateral, taps, strict=True)]
        merged = levels.pop()
        for merge in self.merge:
            merged = merge(functional.interpolate(merged, scale_factor=2, mode="nearest") + levels.pop())
        return self.classify(merged), self.vote(merged)

    def load_encoder(self, state: Mapping[str, Any]) -> None:
        """Load the weights of EfficientNet-Lite0 trained on ImageNet. The weights of additional input channels are 0.

        Raises:
            WeightsError: The state is not a state of EfficientNet-Lite0.
        """
        current = self.state_dict()
        encoder = {name for name in current if name.startswith(("_conv_stem.", "_bn0.", "_blocks."))}
        absent = sorted(name for name in encoder if name not in state)
        if absent:
            raise WeightsError(
                f"the checkpoint (option --encoder) is not EfficientNet-Lite0: {len(absent)} of {len(encoder)} tensors "
                f"are missing, such as {absent[0]}"
            )
        loaded = {name: state[name] for name in encoder}
        stem = torch.zeros_like(current["_conv_stem.weight"])
        stem[:, :3] = loaded["_conv_stem.weight"]
        self.load_state_dict(current | loaded | {"_conv_stem.weight": stem})

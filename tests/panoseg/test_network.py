from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the network is trained with torch: salframe[training]")

from salframe_panoseg.classes import CHANNELS  # noqa: E402

from salframe.framework.errors import WeightsError  # noqa: E402
from training.panoseg.network import PanoSeg, SeamConv, WrapPad  # noqa: E402

STRIDE = 32
"""Columns of a pixel of the encoder's last block."""


@pytest.mark.parametrize(("kernel", "stride"), [(3, 1), (3, 2), (5, 1), (5, 2)])
def test_a_convolution_pads_as_tensorflow_does_and_closes_the_seam(kernel, stride):
    """Against torch's own convolution of an image laid out three times side by side."""
    torch.manual_seed(0)
    conv = SeamConv(2, 3, kernel, stride)
    image = torch.randn(1, 2, 16, 32)
    total = kernel - stride
    before = total // 2
    wide = torch.nn.functional.pad(image.repeat(1, 1, 1, 3), (0, 0, before, total - before))[
        ..., 32 - before : 64 + total - before
    ]
    expected = torch.nn.functional.conv2d(wide, conv.weight, conv.bias, stride)
    torch.testing.assert_close(conv(image), expected)


@pytest.mark.parametrize(("before", "after"), [(1, 1), (0, 1), (1, 2), (2, 2)])
def test_the_gradient_of_a_closed_image_is_that_of_finite_differences(before, after):
    image = torch.randn(1, 2, 5, 7, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda image: WrapPad.apply(image, before, after), (image,))


def test_turning_the_panorama_by_the_stride_turns_the_answer_exactly():
    torch.manual_seed(0)
    network = PanoSeg(5).eval()
    image = torch.randn(1, CHANNELS, 64, 128)
    with torch.inference_mode():
        logits, votes = network(image)
        turned = network(torch.roll(image, STRIDE, -1))
    torch.testing.assert_close(turned[0], torch.roll(logits, STRIDE // 2, -1))
    torch.testing.assert_close(turned[1], torch.roll(votes, STRIDE // 2, -1))
    assert logits.shape == (1, 5, 32, 64)


def test_the_encoder_takes_imagenets_weights_and_ignores_the_new_channels_at_first():
    donor, network = PanoSeg(5), PanoSeg(9)
    state = {
        name: torch.randn_like(value) if value.is_floating_point() else value
        for name, value in donor.state_dict().items()
    }
    state["_conv_stem.weight"] = torch.randn(32, 3, 3, 3)
    network.load_encoder(state)
    np.testing.assert_array_equal(network._conv_stem.weight[:, :3].detach(), state["_conv_stem.weight"])
    assert not network._conv_stem.weight[:, 3:].any()
    np.testing.assert_array_equal(
        network._blocks[3]._expand_conv.weight.detach(), state["_blocks.3._expand_conv.weight"]
    )
    with pytest.raises(WeightsError, match="is not EfficientNet-Lite0"):
        network.load_encoder({"weight": torch.zeros(1)})

"""The range model `transformers-depth`: a published depth network of the library `transformers` on views."""

from __future__ import annotations

from typing import Any

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.files.hub import EXTRA
from salframe.framework.files.weights import NetworkWeights
from salframe.framework.pretrained import PretrainedConfig, PretrainedModel, check_model, find_model_folder, hub_weights
from salframe_depth.monocular import UNSEEN, DepthConfig, MonocularDepth, Quantity

OUTPUTS: dict[str, tuple[Quantity, bool]] = {
    "DPTForDepthEstimation": ("inverse", False),
    "DepthAnythingForDepthEstimation": ("inverse", False),
    "ZoeDepthForDepthEstimation": ("z-depth", True),
    "GLPNForDepthEstimation": ("z-depth", True),
}
"""Quantity that each architecture outputs, and whether it is in metres. The architectures are DPT (Ranftl et al., ICCV
2021), Depth Anything (Yang et al., CVPR 2024, NeurIPS 2024), ZoeDepth (Bhat et al., arXiv 2302.12288) and GLPN (Kim et
al., arXiv 2201.07436)."""
METRIC_DEPTH_ANYTHING: tuple[Quantity, bool] = ("z-depth", True)
"""Output of Depth Anything if its config.json has depth_estimation_type: metric. The values are the quantity, and
whether it is in metres."""


class TransformersDepth(MonocularDepth):
    """Runs a published depth network of the library `transformers` on overlapping views of a panorama.

    Views, alignment, merging and scale are as in `onnx-depth`. The configuration of the network states whether its
    output is in metres. If it is not, `camera_height_m` is required.
    """

    name = "transformers-depth"
    version = "1"
    requires = ("torch", "transformers")
    extra = EXTRA

    class Config(DepthConfig, PretrainedConfig):
        pass

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Load the network and run it once.

        Raises:
            WeightsError: A file is missing, or the network is of a kind that is not supported.
            ConfigError: The settings do not determine the scale, or the size or the device is not valid.
        """
        super().__init__(config)
        folder = find_model_folder(self.config.model)
        # ZoeDepth pads images against errors at their borders, where views have no weight.
        self._model = PretrainedModel(folder, OUTPUTS, self.config.device, self.config.size_px, do_pad=False)
        kind = getattr(self._model.config, "depth_estimation_type", None)
        is_metric = self._model.architecture == "DepthAnythingForDepthEstimation" and kind == "metric"
        self.quantity, self.metric = METRIC_DEPTH_ANYTHING if is_metric else OUTPUTS[self._model.architecture]
        self.size_px = self._model.size_px
        self._check_scale("choose a network that outputs metres")
        self._run_network(np.full((1, *self.size_px[::-1], 3), UNSEEN, np.uint8))

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloaded model of the hub that `model` names; empty if `model` is a folder."""
        return hub_weights(config)

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        check_model(f"the range model {cls.name!r}", config)

    def _run_network(self, images: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                self._model.run(self._model.prepare(batch)).predicted_depth.numpy()
                for batch in self._model.batches(images)
            ]
        )

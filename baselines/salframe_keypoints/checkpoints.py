"""What matchers with trained networks have in common: their checkpoints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import WeightsMissing
from salframe.framework.files.bounded import check_regular
from salframe.framework.files.weights import NetworkWeights
from salframe_keypoints.feature_matcher import FeatureMatcher

MAX_BYTES = 1 << 32
"""Of a checkpoint."""


class TrainedMatcher(FeatureMatcher):
    """Runs networks: those of `weights`, or those that the user's checkpoint holds."""

    extra = "salframe[keypoints]"

    class Config(ComponentConfig):
        checkpoint: UserFile | None = Field(
            None, description="local weights instead of the fetched ones: the file, or the folder that holds them"
        )

    @classmethod
    def paths(cls, config: Any) -> tuple[Path, ...]:
        """The files that the networks are loaded from, verified. Raises WeightsMissing."""
        return tuple(path for weights in cls.weights for path in weights.paths(config.checkpoint))

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """None where the user's checkpoint takes their place."""
        return cls.weights if config.checkpoint is None else ()

    @classmethod
    def check(cls, config: Any) -> None:
        """Raises RequirementMissing, or WeightsMissing where the networks are not at hand."""
        super().check(config)
        if not cls.weights_in_use(config):
            cls.paths(config)


def read_checkpoint(path: Path) -> Any:
    """What a torch checkpoint holds, on the CPU, without running code from it. Raises WeightsMissing."""
    import torch

    try:
        check_regular(path, MAX_BYTES)
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises whatever its unpickler stumbles over
        raise WeightsMissing(f"{path} is no torch checkpoint: {type(error).__name__} {_one_line(error)}") from None


def load_strictly(module: Any, state: Any, path: Path, computed: str | None = None) -> None:
    """Put a state into a torch module, every tensor of both accounted for. Raises WeightsMissing.

    `computed` names a buffer of the module that is not learned: it stays, whether or not the state has it.
    """
    try:
        module.load_state_dict(dict(state) | ({computed: module.get_buffer(computed)} if computed else {}))
    except (RuntimeError, TypeError, ValueError) as error:
        raise WeightsMissing(f"{path} does not fit {type(module).__name__}: {_one_line(error)}") from None


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else f"{text[:200]}..."

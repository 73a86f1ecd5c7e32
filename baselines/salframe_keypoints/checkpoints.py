"""Checkpoints of matchers with trained networks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import WeightsError
from salframe.framework.files.bounded import check_regular
from salframe.framework.files.weights import NetworkWeights
from salframe_keypoints.feature_matcher import FeatureMatcher

MAX_BYTES = 1 << 32
"""Maximum size of a checkpoint in bytes."""


class TrainedMatcher(FeatureMatcher):
    """Base class of matchers with trained networks, whose weights are downloaded or read from a file of the user."""

    extra = "salframe[keypoints]"

    class Config(ComponentConfig):
        checkpoint: UserFile | None = Field(
            None,
            description="path of a file with weights, or of a folder with several such files; null: the "
            "downloaded weights",
        )

    @classmethod
    def paths(cls, config: Any) -> tuple[Path, ...]:
        """Return the verified files of the networks. Raises WeightsError if one is not installed."""
        return tuple(path for weights in cls.weights for path in weights.paths(config.checkpoint))

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloaded weights; none if the user's checkpoint replaces them."""
        return cls.weights if config.checkpoint is None else ()

    @classmethod
    def check(cls, config: Any) -> None:
        """Raise RequirementMissing if a package is not installed, and WeightsError if the weights are not installed."""
        super().check(config)
        if not cls.weights_in_use(config):
            cls.paths(config)


def read_checkpoint(path: Path) -> Any:
    """Load a torch checkpoint to the CPU without executing code from it.

    Raises:
        WeightsError: The file is not a torch checkpoint.
    """
    import torch

    try:
        check_regular(path, MAX_BYTES)
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # the unpickler of torch raises many types of exceptions
        raise WeightsError(f"{path} is not a torch checkpoint: {type(error).__name__} {_one_line(error)}") from None


def load_strictly(module: Any, state: Any, path: Path, computed: str | None = None) -> None:
    """Load a state into a torch module. The names and shapes of all tensors must match.

    Args:
        module: The module.
        state: Tensors by name.
        path: File of the state, for error messages.
        computed: Name of a buffer of the module that is not learned. It is not loaded, and the state may lack it.

    Raises:
        WeightsError: The state does not match the module.
    """
    try:
        module.load_state_dict(dict(state) | ({computed: module.get_buffer(computed)} if computed else {}))
    except (RuntimeError, TypeError, ValueError) as error:
        raise WeightsError(f"{path} does not match the network {type(module).__name__}: {_one_line(error)}") from None


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else f"{text[:200]}..."

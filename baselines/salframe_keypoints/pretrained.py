"""Models of the library `transformers`, which the user has downloaded to a folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.framework.errors import DataError, WeightsError
from salframe.framework.files.reading import read_json


@dataclass(frozen=True)
class Pretrained:
    """A model in the layout of the Hugging Face hub: a folder with config.json and model.safetensors.

    The weights are read without executing code.

    Attributes:
        repository: Repository on the hub.
        licence: Licence of the weights.
        model_class: Name of the class in transformers.
        model_type: model_type in config.json.
    """

    repository: str
    licence: str
    model_class: str
    model_type: str

    def files(self, folder: Path | None) -> tuple[Path, Path]:
        """Return the paths of config.json and model.safetensors in a local folder.

        Raises:
            WeightsError: A file does not exist or belongs to another model.
        """
        address = f"https://huggingface.co/{self.repository} ({self.licence})"
        where = f"a folder with config.json and model.safetensors of {address}"
        if folder is None:
            raise WeightsError(
                f"salframe does not include the weights of the network {self.model_type!r}: set checkpoint to {where}",
                "checkpoint=FOLDER",
            )
        config, weights = folder / "config.json", folder / "model.safetensors"
        for path in (config, weights):
            if not path.is_file():
                raise WeightsError(f"{path} does not exist, expected {where}")
        try:
            content = read_json(config)
        except DataError as error:
            raise WeightsError(str(error)) from None
        received = content.get("model_type") if isinstance(content, dict) else None
        if received != self.model_type:
            raise WeightsError(f"{config} has the model_type {received!r}, expected {self.model_type!r}")
        return config, weights

    def load(self, folder: Path | None) -> Any:
        """Load the model. Raises WeightsError if any tensor is missing, unexpected or of another shape."""
        from salframe.framework.pretrained import load_network

        config, weights = self.files(folder)
        model, report = load_network(config.parent, self.model_class)
        for key in ("missing_keys", "unexpected_keys", "mismatched_keys"):
            if report[key]:
                keys = sorted(map(str, report[key]))[:3]
                raise WeightsError(
                    f"{weights} does not match the network {self.model_class}: {key.replace('_', ' ')} "
                    f"{', '.join(keys)}"
                )
        return model

"""Models of the library `transformers` in a folder that the user has downloaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.framework.errors import DataError, WeightsMissing
from salframe.framework.files.reading import read_json


@dataclass(frozen=True)
class Pretrained:
    """A model as Hugging Face's hub lays it out, a folder of config.json and model.safetensors; the weights are read
    without running code.

    It has no entry among the weights that can be fetched, as nobody publishes a hash of its files that could be held
    against a download.
    """

    repository: str
    licence: str
    model_class: str
    model_type: str

    def files(self, folder: Path | None) -> tuple[Path, Path]:
        """config.json and model.safetensors of a local folder. Raises WeightsMissing where they are not there or are of
        another model."""
        address = f"https://huggingface.co/{self.repository} ({self.licence})"
        where = f"a folder with config.json and model.safetensors of {address}"
        if folder is None:
            raise WeightsMissing(f"{self.model_type} is not shipped: set checkpoint to {where}")
        config, weights = folder / "config.json", folder / "model.safetensors"
        for path in (config, weights):
            if not path.is_file():
                raise WeightsMissing(f"no file {path}, expected {where}")
        try:
            content = read_json(config)
        except DataError as error:
            raise WeightsMissing(str(error)) from None
        received = content.get("model_type") if isinstance(content, dict) else None
        if received != self.model_type:
            raise WeightsMissing(f"{config} has model_type {received!r}, expected {self.model_type!r}")
        return config, weights

    def load(self, folder: Path | None) -> Any:
        """The model, every tensor of it accounted for. Raises WeightsMissing."""
        import transformers

        config, weights = self.files(folder)
        transformers.utils.logging.disable_progress_bar()
        try:
            model, report = getattr(transformers, self.model_class).from_pretrained(
                config.parent, local_files_only=True, use_safetensors=True, output_loading_info=True
            )
        except Exception as error:  # the library raises whatever its parsers stumble over
            text = " ".join(str(error).split())
            raise WeightsMissing(
                f"{weights} does not fit {self.model_class}: {type(error).__name__} {text[:200]}"
            ) from None
        for what in ("missing_keys", "unexpected_keys", "mismatched_keys"):
            if report[what]:
                keys = sorted(map(str, report[what]))[:3]
                raise WeightsMissing(f"{weights} does not fit {self.model_class}: {what.replace('_', ' ')} {keys}")
        return model.eval()

"""Networks of the library `transformers` in local folders, with the image processors of the library.

Weights are read from safetensors files. Nothing is downloaded, and no code of a folder is executed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import ConfigError, DataError, WeightsError, content_type, one_line, shorten
from salframe.framework.files.hub import HubName, find_hub_model, is_hub_name
from salframe.framework.files.reading import read_json
from salframe.framework.files.weights import NetworkWeights

Device = Literal["auto", "cpu", "cuda", "mps"]
"""Processor that runs a network. auto: the first of cuda, mps and cpu that this machine has."""
CONFIG, WEIGHTS = "config.json", ("model.safetensors", "model.safetensors.index.json")
GPU_BATCH = 8
"""Number of images per run on a GPU. On a CPU, larger batches take more memory and save no time."""
MAX_NAMED = 6
"""Maximum number of architectures to name in an error."""
DEFAULT_SIDE_PX = 512
"""Width and height of images for a network whose image processor states no size."""


class PretrainedConfig(ComponentConfig):
    """Settings of components that run a network of the library `transformers`."""

    model: HubName | UserFile | None = Field(
        None,
        union_mode="left_to_right",
        description="path of a folder with config.json and model.safetensors; or hf:ORG/MODEL[@REVISION], a model of "
        "the Hugging Face hub that `salframe weights fetch` downloads; required",
    )
    size_px: tuple[int, int] | None = Field(
        None,
        description="width and height of the network's input (pixels), such as [640, 480]; null: the size that the "
        "model's image processor states",
    )
    device: Device = Field(
        "auto",
        description="device that runs the network. auto: the first of cuda, mps and cpu that this machine has; cpu: "
        "the main processor; cuda: an NVIDIA GPU; mps: an Apple GPU. On a GPU, the network runs in half precision",
    )


def hub_weights(config: PretrainedConfig) -> tuple[NetworkWeights, ...]:
    """Return the downloaded model of the Hugging Face hub that the setting `model` names, or () if it is a folder or
    None. Raises WeightsError."""
    return (find_hub_model(config.model),) if isinstance(config.model, HubName) else ()


def check_model(component: str, config: PretrainedConfig) -> None:
    """Raise WeightsError if the setting `model` names no model on this machine. `component` begins the message."""
    if config.model is None:
        raise WeightsError(
            f"{component} has no network: set the setting `model` to the folder of a model, or to hf:ORG/MODEL "
            "(a model of the Hugging Face hub)",
            "model=FOLDER",
        )
    read_model_config(find_model_folder(config.model))


def find_model_folder(model: str | Path) -> Path:
    """Return the folder of a model: a local folder, or the folder of a downloaded model of the Hugging Face hub
    (hf:ORG/MODEL).

    Raises:
        WeightsError: There is no such folder, or the model was not downloaded, or one of its files has changed.
    """
    if is_hub_name(str(model)):
        weights = find_hub_model(str(model))
        weights.paths()
        return weights.folder
    folder = Path(model)
    if not folder.is_dir():
        raise WeightsError(
            f"the model folder {folder} does not exist, expected a folder with {CONFIG} and {WEIGHTS[0]}, or "
            "hf:ORG/MODEL of a model that `salframe weights fetch` downloaded"
        )
    return folder


def read_model_config(folder: Path) -> Mapping[str, Any]:
    """Return the content of a model's config.json.

    Raises:
        WeightsError: The folder has no configuration or no safetensors.
    """
    for names in ((CONFIG,), WEIGHTS):
        if not any((folder / name).is_file() for name in names):
            raise WeightsError(
                f"{folder / names[0]} does not exist, expected a folder with {CONFIG} and {WEIGHTS[0]} "
                "(salframe does not load other formats of weights, because they can execute code)"
            )
    try:
        content = read_json(folder / CONFIG)
    except DataError as error:
        raise WeightsError(str(error)) from None
    if not isinstance(content, Mapping):
        raise WeightsError(f"{folder / CONFIG} contains {content_type(content)}, expected a JSON object")
    return content


def load_network(folder: Path, class_name: str) -> tuple[Any, dict[str, Any]]:
    """Load a network in float32.

    Args:
        folder: The folder with config.json and model.safetensors.
        class_name: Name of the class in transformers.

    Returns:
        The network, and the library's report with missing and unexpected tensors.

    Raises:
        WeightsError: The files do not fit the class. The message is one line.
    """
    import torch
    import transformers

    with _without_network():
        try:
            network, report = getattr(transformers, class_name).from_pretrained(
                folder,
                local_files_only=True,
                use_safetensors=True,
                trust_remote_code=False,
                dtype=torch.float32,
                output_loading_info=True,
            )
        except Exception as error:  # the parsers of the library raise many types of exceptions
            raise WeightsError(
                f"{folder / WEIGHTS[0]} does not match the network {class_name}: {type(error).__name__} "
                f"{shorten(one_line(error))}"
            ) from None
    return network.eval(), report


class PretrainedModel:
    """A network with its image processor, ready to run.

    Attributes:
        folder: The folder of the model.
        architecture: Name of the network's class in transformers.
        config: The network's configuration in transformers.
        image_processor: The model's image processor, in the implementation that uses Pillow.
        tokenizer: The model's tokenizer. None if the caller needs no text.
        size_px: Width and height of the images that the network takes.
        batch: Number of images per run.
    """

    def __init__(
        self,
        folder: Path,
        architectures: Collection[str],
        device: Device = "auto",
        size_px: tuple[int, int] | None = None,
        *,
        takes_text: bool = False,
        **processing: Any,
    ) -> None:
        """Load a model.

        Args:
            folder: The folder with config.json, model.safetensors and the files of the processor.
            architectures: Names of the classes in transformers that the caller can use.
            device: The processor that runs the network.
            size_px: Width and height of the images; None: those of the image processor.
            takes_text: Whether the model needs its tokenizer.
            processing: Settings of the image processor that replace those of the model.

        Raises:
            WeightsError: A file is missing, or the model has another architecture.
            ConfigError: This machine does not have the device.
        """
        self.folder = folder
        self.tokenizer: Any = None
        self.architecture = read_architecture(folder, architectures)
        self.device = _choose_device(device)
        self.batch = 1 if self.device == "cpu" else GPU_BATCH
        self.image_processor = _load_part("AutoImageProcessor", folder, backend="pil", **_no_metadata(folder))
        if takes_text:
            self.tokenizer = _load_part("AutoTokenizer", folder)
        self._network, report = load_network(folder, self.architecture)
        self._missing = sorted(map(str, report["missing_keys"]))
        _fill_with_nan(self._network, self._missing)
        self._network.to(self.device)
        self.config = self._network.config
        self.size_px = _input_size(self.image_processor) if size_px is None else size_px
        self._processing = dict(processing)
        if size_px is not None:
            self._processing["size"] = {"width": size_px[0], "height": size_px[1]}
        if getattr(self.image_processor, "do_center_crop", None) is not None:
            self._processing["do_center_crop"] = False  # a crop would remove the border of a view

    def prepare(self, images: np.ndarray) -> dict[str, Any]:
        """Return the inputs of the network for images (n, height, width, 3) uint8 RGB."""
        return dict(self.image_processor(images=list(images), return_tensors="pt", **self._processing))

    def run(self, inputs: Mapping[str, Any]) -> Any:
        """Return the output of the network for tensors, as float32 tensors on the CPU.

        On a GPU, the network runs in half precision.

        Raises:
            WeightsError: The network cannot run on these inputs, or needs tensors that its file does not have.
        """
        import torch

        on_gpu = self.device != "cpu"
        precision = torch.autocast(self.device, torch.float16) if on_gpu else nullcontext()
        try:
            with torch.inference_mode(), precision:
                output = self._network(**{name: value.to(self.device) for name, value in inputs.items()})
        except Exception as error:  # networks raise many types of exceptions
            shapes = ", ".join(f"{name} {tuple(value.shape)}" for name, value in inputs.items())
            reason = shorten(one_line(error), 120)
            raise WeightsError(
                f"the network in {self.folder} failed on the inputs {shapes}: {type(error).__name__} {reason}"
            ) from None
        for name, value in list(output.items()):
            if isinstance(value, torch.Tensor) and value.is_floating_point():
                output[name] = value.float().cpu()
                if torch.isnan(value).any():
                    missing = (
                        f", and its file lacks the weights {', '.join(self._missing[:3])}" if self._missing else ""
                    )
                    raise WeightsError(
                        f"the network in {self.folder} returned NaN in the output {name}{missing}, expected numbers"
                    )
        return output

    def batches(self, images: np.ndarray) -> Iterator[np.ndarray]:
        """Yield images (n, height, width, 3) in parts of at most `batch`."""
        yield from (images[first : first + self.batch] for first in range(0, len(images), self.batch))

    def labels(self) -> tuple[str, ...]:
        """Return the labels of the classes, in the order of the network's output."""
        return tuple(str(self.config.id2label[number]) for number in sorted(self.config.id2label))


def read_architecture(folder: Path, architectures: Collection[str]) -> str:
    """Return the first architecture in a model's config.json that is in `architectures`. Raises WeightsError."""
    received = read_model_config(folder).get("architectures")
    names = [name for name in received if name in architectures] if isinstance(received, Sequence) else []
    if not names:
        raise WeightsError(
            f"{folder / CONFIG} has the architectures {received!r}, expected one of those that the component can use, "
            f"such as {', '.join(sorted(architectures)[:MAX_NAMED])}: choose another model"
        )
    return str(names[0])


def _no_metadata(folder: Path) -> dict[str, None]:
    """Return settings that keep OneFormer's image processor from reading the annotations of its training data."""
    return {"class_info_file": None} if read_model_config(folder).get("model_type") == "oneformer" else {}


def _load_part(class_name: str, folder: Path, **settings: Any) -> Any:
    """Return the processor or tokenizer of a model. Raises WeightsError."""
    import transformers

    load: Callable[..., Any] = getattr(transformers, class_name).from_pretrained
    with _without_network():
        try:
            return load(folder, local_files_only=True, trust_remote_code=False, **settings)
        except Exception as error:  # the parsers of the library raise many types of exceptions
            raise WeightsError(
                f"the {class_name.removeprefix('Auto')} in {folder} is missing or invalid: {shorten(one_line(error))}"
            ) from None


def _input_size(processor: Any) -> tuple[int, int]:
    """Return the width and height of the images that an image processor gives to its network."""
    size = getattr(processor, "size", None)
    sides = {name: value for name, value in vars(size).items() if value} if size is not None else {}
    if "width" in sides and "height" in sides:
        return int(sides["width"]), int(sides["height"])
    side = next((sides[name] for name in ("shortest_edge", "max_height", "longest_edge") if name in sides), None)
    return (DEFAULT_SIDE_PX,) * 2 if side is None else (int(side),) * 2


def _fill_with_nan(network: Any, names: Collection[str]) -> None:
    """Set missing tensors to NaN, so that `run` reports those that affect the output. Others may be missing."""
    for name, tensor in (*network.named_parameters(), *network.named_buffers()):
        if name in names and tensor.is_floating_point():
            tensor.data.fill_(float("nan"))


def _choose_device(device: Device) -> str:
    """Return the name of a device that this machine has. Raises ConfigError."""
    import torch

    has = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(), "cpu": True}
    if device == "auto":
        return next(name for name, available in has.items() if available)
    if not has[device]:
        available = ", ".join(name for name, is_here in has.items() if is_here)
        raise ConfigError(
            f"the setting device is {device!r}, which this machine does not have, expected one of {available}"
        )
    return device


@contextmanager
def _without_network() -> Iterator[None]:
    """Keep the libraries from downloading anything and from printing."""
    import transformers
    from huggingface_hub import constants

    transformers.utils.logging.disable_progress_bar()
    transformers.utils.logging.set_verbosity_error()
    before = constants.HF_HUB_OFFLINE
    constants.HF_HUB_OFFLINE = True
    try:
        yield
    finally:
        constants.HF_HUB_OFFLINE = before

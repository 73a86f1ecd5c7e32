"""ONNX networks, run by onnxruntime on the CPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.engines.worker import threads_allowed
from salframe.framework.errors import WeightsError, one_line, shorten
from salframe.framework.files.onnx_files import SUFFIX, external_files
from salframe.framework.files.reading import read_network

Shape = tuple[int | None, ...]
"""Lengths of the axes of a tensor, batch first. None stands for any length."""


@dataclass(frozen=True)
class Tensor:
    """An input of a network: its name, the numpy name of its dtype, and its shape."""

    name: str
    dtype: str
    shape: Shape

    def __str__(self) -> str:
        return f"{self.name} {_layout(self.dtype, self.shape)}"


class OnnxModel:
    """A loaded network. Use `open_model` to load one.

    Attributes:
        path: The file of the network.
        inputs: The inputs of the network, in order.
        outputs: The names of the arrays that `run` returns.
    """

    def __init__(
        self, path: Path, session: Any, inputs: tuple[Tensor, ...], outputs: tuple[str, ...], *, has_batch: bool
    ) -> None:
        self.path, self._session, self.inputs, self.outputs = path, session, inputs, outputs
        self._has_batch = has_batch

    def run(self, *arrays: np.ndarray) -> list[np.ndarray]:
        """Return one array for each of `outputs`, for a batch.

        A network that does not support batches (its first axis is 1) runs once per element, and its outputs are
        concatenated.

        Args:
            arrays: One array for each of `inputs`, in order. The first axis is the batch.

        Raises:
            WeightsError: The network cannot run, an output has another batch size, or it contains no finite number.
        """
        names = [tensor.name for tensor in self.inputs]
        if all(tensor.shape[:1] == (1,) for tensor in self.inputs) and len(arrays[0]) > 1:
            single = [self.run(*(array[i : i + 1] for array in arrays)) for i in range(len(arrays[0]))]
            return [np.concatenate(parts) for parts in zip(*single, strict=True)]
        try:
            results = self._session.run(list(self.outputs), dict(zip(names, arrays, strict=True)))
        except Exception as error:  # the exceptions of onnxruntime have no common base class
            shapes = " and ".join(str(array.shape) for array in arrays)
            reason = shorten(one_line(error), 120)
            raise WeightsError(
                f"the network {self.path} failed on inputs of shape {shapes}, although it declares these shapes: "
                f"{reason}"
            ) from None
        for name, result in zip(self.outputs, results, strict=True):
            self._check_output(name, result, len(arrays[0]))
        return results

    def _check_output(self, name: str, result: Any, batch: int) -> None:
        """Raise WeightsError on an output that is no array, has another batch size, or has no finite number."""
        if not isinstance(result, np.ndarray):
            raise WeightsError(
                f"the network {self.path} returned a value of type {type(result).__name__} as the output {name}, "
                "expected an array"
            )
        if self._has_batch and result.shape[:1] != (batch,):
            raise WeightsError(
                f"the network {self.path} returned the output {name} of shape {result.shape} for a batch of {batch}, "
                f"expected a first axis of length {batch}"
            )
        if result.size and result.dtype.kind == "f" and not np.isfinite(result).any():
            raise WeightsError(
                f"the network {self.path} returned only NaN or infinity as the output {name}, expected finite numbers"
            )


def open_model(
    path: Path, inputs: Sequence[Shape] | None = None, outputs: Sequence[str] = (), dtype: str = "float32"
) -> OnnxModel:
    """Load a network from an ONNX file.

    Args:
        path: The file.
        inputs: The expected shape of each input, in order. None skips the check.
        outputs: Names of the tensors that `run` returns, which may be inner tensors. Empty for the declared outputs.
        dtype: The expected dtype of all inputs.

    Raises:
        WeightsError: The file is not an ONNX network with these inputs and outputs, or points to a file that is missing
            or outside its folder. The message is one line.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads_allowed() or 0
    options.log_severity_level = 4  # only fatal errors: others are raised, and users cannot fix warnings of a network
    options.add_session_config_entry(
        "session.intra_op.allow_spinning", "0"
    )  # spinning threads would occupy cores that other methods can use
    # The network is loaded from bytes, to which outputs are added, so the runtime does not know its folder.
    options.add_session_config_entry(
        "session.model_external_initializers_file_folder_path", str(path.parent.absolute())
    )
    content = read_network(path)
    if external_files(path) and path.suffix.lower() != SUFFIX:
        raise WeightsError(
            f"the network {path} stores weights in other files, so its file name must end in {SUFFIX}: rename the file"
        )
    try:
        session = onnxruntime.InferenceSession(
            b"".join([content, *map(_as_output, outputs)]), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # the exceptions of onnxruntime have no common base class
        tensor_names = f" with a tensor {', '.join(outputs)}" if outputs else ""
        raise WeightsError(
            f"{path} is not an ONNX network{tensor_names}: {' '.join(str(error).split())[:200]}"
        ) from None
    model = OnnxModel(
        path,
        session,
        tuple(map(_tensor, session.get_inputs())),
        tuple(outputs) or tuple(o.name for o in session.get_outputs()),
        has_batch=inputs is not None,
    )
    if inputs is not None and not _fits(model.inputs, inputs, dtype):
        received = ", ".join(map(str, model.inputs))
        expected = ", ".join(_layout(dtype, shape) for shape in inputs)
        raise WeightsError(f"the network {path} has the inputs {received}, expected {expected} (*: any length)")
    return model


def _tensor(node: Any) -> Tensor:
    """Return an input of an onnxruntime session as a `Tensor`."""
    dtype = {"float": "float32", "double": "float64"}.get(
        kind := node.type.removeprefix("tensor(").removesuffix(")"), kind
    )
    return Tensor(node.name, dtype, tuple(length if isinstance(length, int) else None for length in node.shape))


def _fits(received: Sequence[Tensor], expected: Sequence[Shape], dtype: str) -> bool:
    return (
        len(received) == len(expected)
        and all(
            tensor.dtype == dtype
            and len(tensor.shape) == len(shape)
            and tensor.shape[0] in (None, 1, shape[0])  # `run` splits batches for networks with a batch size of 1
            and all(
                None in lengths or len(set(lengths)) == 1 for lengths in zip(tensor.shape[1:], shape[1:], strict=True)
            )
            for tensor, shape in zip(received, expected, strict=True)
        )
    )


def _layout(dtype: str, shape: Shape) -> str:
    return f"{dtype} ({', '.join('*' if length is None else str(length) for length in shape)})"


def _as_output(name: str) -> bytes:
    """Return bytes that, appended to an ONNX file, declare the tensor of this name as an output.

    Concatenated protobuf messages are merged.

    ModelProto has its graph in field 7, GraphProto its outputs in field 12, ValueInfoProto its name in field 1
    (onnx.proto3).
    """
    return _field(7, _field(12, _field(1, name.encode())))


def _field(number: int, content: bytes) -> bytes:
    """Return a length-delimited protobuf field."""
    length, size = len(content), b""
    while length > 0x7F:
        size, length = size + bytes([length & 0x7F | 0x80]), length >> 7
    return bytes([number << 3 | 2]) + size + bytes([length]) + content

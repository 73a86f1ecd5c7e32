"""Networks in ONNX, run by onnxruntime on the CPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.engines.worker import threads_allowed
from salframe.framework.errors import WeightsMissing
from salframe.framework.files.reading import read_network

Shape = tuple[int | None, ...]
"""Lengths of a tensor's axes, the batch first; None for any length."""


@dataclass(frozen=True)
class Tensor:
    """An input of a network: its name, its dtype by numpy's name, its shape."""

    name: str
    dtype: str
    shape: Shape

    def __str__(self) -> str:
        return f"{self.name} {_layout(self.dtype, self.shape)}"


class OnnxModel:
    """A network ready to run; `open_model` makes it. inputs: what it takes, in its order; outputs: names of what `run`
    gives."""

    def __init__(self, session: Any, inputs: tuple[Tensor, ...], outputs: tuple[str, ...]) -> None:
        self._session, self.inputs, self.outputs = session, inputs, outputs

    def run(self, *arrays: np.ndarray) -> list[np.ndarray]:
        """The outputs for a batch: one array an input, in the order of `inputs`, all with the batch as their first
        axis.

        A network that takes no batch (its first axis is 1) is run once an element, and its outputs are put together
        again.
        """
        names = [tensor.name for tensor in self.inputs]
        if all(tensor.shape[:1] == (1,) for tensor in self.inputs) and len(arrays[0]) > 1:
            single = [self.run(*(array[i : i + 1] for array in arrays)) for i in range(len(arrays[0]))]
            return [np.concatenate(parts) for parts in zip(*single, strict=True)]
        return self._session.run(list(self.outputs), dict(zip(names, arrays, strict=True)))


def open_model(
    path: Path, inputs: Sequence[Shape] | None = None, outputs: Sequence[str] = (), dtype: str = "float32"
) -> OnnxModel:
    """The network in a file.

    inputs: the shape that the caller will give for each of its inputs, in their order, all of `dtype`; None: the caller
    looks at `inputs` of the model itself. outputs: names of any of its tensors, inner ones too; none: the outputs that
    the file declares. Raises WeightsMissing where the file is no such network, in one line: what was received, what was
    expected.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads_allowed() or 0
    options.log_severity_level = 3  # errors only: they are raised as well, and warnings are for who made the file
    options.add_session_config_entry(
        "session.intra_op.allow_spinning", "0"
    )  # waiting threads would hold cores that other methods could use
    content = read_network(path)
    try:
        session = onnxruntime.InferenceSession(
            b"".join([content, *map(_as_output, outputs)]), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime has an exception a cause, with no base of their own
        named = f" with a tensor {', '.join(outputs)}" if outputs else ""
        raise WeightsMissing(f"{path} is no ONNX network{named}: {' '.join(str(error).split())[:200]}") from None
    model = OnnxModel(
        session,
        tuple(map(_tensor, session.get_inputs())),
        tuple(outputs) or tuple(o.name for o in session.get_outputs()),
    )
    if inputs is not None and not _fits(model.inputs, inputs, dtype):
        received = ", ".join(map(str, model.inputs))
        raise WeightsMissing(
            f"{path} takes {received}, expected {', '.join(_layout(dtype, shape) for shape in inputs)}"
        )
    return model


def _tensor(declared: Any) -> Tensor:
    dtype = {"float": "float32", "double": "float64"}.get(
        kind := declared.type.removeprefix("tensor(").removesuffix(")"), kind
    )
    return Tensor(declared.name, dtype, tuple(length if isinstance(length, int) else None for length in declared.shape))


def _fits(received: Sequence[Tensor], expected: Sequence[Shape], dtype: str) -> bool:
    return (
        len(received) == len(expected)
        and all(
            tensor.dtype == dtype
            and len(tensor.shape) == len(shape)
            and tensor.shape[0]
            in (None, 1, shape[0])  # `run` splits a batch for a network that takes one element at a time
            and all(
                None in lengths or len(set(lengths)) == 1 for lengths in zip(tensor.shape[1:], shape[1:], strict=True)
            )
            for tensor, shape in zip(received, expected, strict=True)
        )
    )


def _layout(dtype: str, shape: Shape) -> str:
    return f"{dtype} ({', '.join('*' if length is None else str(length) for length in shape)})"


def _as_output(name: str) -> bytes:
    """What, appended to an ONNX file, makes the tensor of this name an output: protobuf messages merge when they are
    put end to end.

    ModelProto has its graph in field 7, GraphProto its outputs in field 12, ValueInfoProto its name in field 1
    (onnx.proto3).
    """
    return _field(7, _field(12, _field(1, name.encode())))


def _field(number: int, content: bytes) -> bytes:
    """A length-delimited protobuf field."""
    length, size = len(content), b""
    while length > 0x7F:
        size, length = size + bytes([length & 0x7F | 0x80]), length >> 7
    return bytes([number << 3 | 2]) + size + bytes([length]) + content

"""The network of colour_network.py as a TensorFlow Lite file, float or quantized, built by the format's schema."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from colour_network import COLOURS, SIDE_PX, kernel, write_card

schema = pytest.importorskip("ai_edge_litert.schema_py_generated")

LOGIT_SCALE, LOGIT_ZERO = 1.0, 128


def write_tflite(path: Path, quantized: bool = False) -> Path:
    """(1, SIDE_PX, SIDE_PX, 3) to class ids, whose tensor 'logits' lies before; its card, which names it, beside it.

    quantized: images and logits are uint8; a logit is LOGIT_SCALE * (number - LOGIT_ZERO).
    """
    weights, biases = kernel()
    model, graph = schema.ModelT(), schema.SubGraphT()
    model.version, model.description, model.subgraphs = 3, b"colours", [graph]
    model.buffers, graph.tensors = [schema.BufferT()], []
    kind = schema.TensorType.UINT8 if quantized else schema.TensorType.FLOAT32

    def tensor(name, shape, kind, data=None, quantization=None):
        one = schema.TensorT()
        one.name, one.shape, one.type, one.buffer = name.encode(), list(shape), kind, 0
        if data is not None:
            buffer = schema.BufferT()
            buffer.data = np.frombuffer(np.ascontiguousarray(data).tobytes(), np.uint8)
            model.buffers.append(buffer)
            one.buffer = len(model.buffers) - 1
        if quantization is not None:
            one.quantization = schema.QuantizationParametersT()
            one.quantization.scale, one.quantization.zeroPoint = [quantization[0]], [quantization[1]]
        graph.tensors.append(one)
        return len(graph.tensors) - 1

    number, side = len(COLOURS), SIDE_PX
    if quantized:
        scale = float(np.abs(weights).max() / 127)
        stored = np.round(weights / scale + 128).astype(np.uint8), np.round(biases / scale).astype(np.int32)
        scales = (1.0, 0), (scale, 128), (scale, 0), (LOGIT_SCALE, LOGIT_ZERO)
    else:
        stored, scales = (weights, biases), (None,) * 4
    views = tensor("views", (1, side, side, 3), kind, None, scales[0])
    filters = tensor("filters", (number, 1, 1, 3), kind, stored[0].reshape(number, 1, 1, 3), scales[1])
    offsets = schema.TensorType.INT32 if quantized else schema.TensorType.FLOAT32
    offset = tensor("offsets", (number,), offsets, stored[1], scales[2])
    logits = tensor("logits", (1, side, side, number), kind, None, scales[3])
    axis = tensor("axis", (), schema.TensorType.INT32, np.int32(3))
    classes = tensor("classes", (1, side, side), schema.TensorType.INT32)

    convolution, choice = schema.Conv2DOptionsT(), schema.ArgMaxOptionsT()
    convolution.strideW = convolution.strideH = 1
    choice.outputType = schema.TensorType.INT32
    model.operatorCodes, graph.operators = [], []
    for code, options, kind_of, inputs, output in (
        (
            schema.BuiltinOperator.CONV_2D,
            convolution,
            schema.BuiltinOptions.Conv2DOptions,
            (views, filters, offset),
            logits,
        ),
        (schema.BuiltinOperator.ARG_MAX, choice, schema.BuiltinOptions.ArgMaxOptions, (logits, axis), classes),
    ):
        declared, operator = schema.OperatorCodeT(), schema.OperatorT()
        declared.builtinCode = declared.deprecatedBuiltinCode = code
        declared.version = 1
        model.operatorCodes.append(declared)
        operator.opcodeIndex, operator.inputs, operator.outputs = len(model.operatorCodes) - 1, list(inputs), [output]
        operator.builtinOptionsType, operator.builtinOptions = kind_of, options
        graph.operators.append(operator)
    graph.inputs, graph.outputs = [views], [classes]
    builder = pytest.importorskip("flatbuffers").Builder(1024)
    builder.Finish(model.Pack(builder), b"TFL3")
    path.write_bytes(bytes(builder.Output()))
    taken = {"layout": "nhwc", "size_px": [side, side], "dtype": "uint8" if quantized else "float32"}
    write_card(path, input=taken, output={"name": "logits", "layout": "nhwc", "values": "logits"})
    return path

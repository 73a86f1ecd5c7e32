"""Small models of the architectures of `transformers`, in the official format: a folder with config.json,
model.safetensors and the files of the image processor and the tokenizer.

The answers of the semantic network and of two depth networks are known in closed form. The others have random weights.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")

SIDE_PX = 64
COLOURS = {
    "wall": (0, 0, 0),
    "armchair": (255, 0, 0),
    "plant": (0, 255, 0),
    "television": (0, 0, 255),
    "windowpane": (255, 255, 0),
}
"""Colours of the classes of the semantic network; they are labels of ADE20K."""
SHARPNESS = 2.0
SIZE = {"height": SIDE_PX, "width": SIDE_PX}
HALF = {"image_mean": [0.5] * 3, "image_std": [0.5] * 3}
"""Normalisation of colours to -1 to 1."""


def save(folder: Path, model: Any, processor: Any) -> Path:
    """Save a model and its processor in the official format."""
    transformers.utils.logging.disable_progress_bar()
    model.save_pretrained(folder)
    processor.save_pretrained(folder)
    return folder


def with_labels(labels: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a configuration with these labels."""
    return {"id2label": dict(enumerate(labels)), "label2id": {label: i for i, label in enumerate(labels)}}


def segformer(folder: Path) -> Path:
    """SegFormer whose most likely class at a pixel is that of COLOURS nearest to its colour.

    With colours (r, g, b) from -1 to 1, the patch embedding of 4 x 4 pixels is v = (r, g, b, 1) and -v. All corners of
    the colour cube have the same length, so that layer normalisation gives v / |v| times 2. The blocks add 0. The head
    uses the first stage only: logits are SHARPNESS * c v for the v = c of each class.
    """
    config = transformers.SegformerConfig(
        depths=[1] * 4,
        hidden_sizes=[8] * 4,
        num_attention_heads=[1] * 4,
        sr_ratios=[1] * 4,
        decoder_hidden_size=8,
        **with_labels(tuple(COLOURS)),
    )
    processor = transformers.SegformerImageProcessorPil(size=SIZE, do_reduce_labels=False, **HALF)
    save(folder, transformers.SegformerForSemanticSegmentation(config), processor)
    embedding, fuse = torch.zeros(8, 3, 7, 7), torch.zeros(8, 32, 1, 1)
    for channel in range(3):
        embedding[channel, channel, 3:, 3:] = 1 / 16
        embedding[channel + 4, channel, 3:, 3:] = -1 / 16
    fuse[:, 24:, 0, 0] = torch.eye(8)  # the first stage comes last
    corners = torch.tensor(corners_of_classes(), dtype=torch.float32)
    set_weights(
        folder,
        {
            "segformer.encoder.patch_embeddings.0.proj.weight": embedding,
            "segformer.encoder.patch_embeddings.0.proj.bias": torch.tensor([0, 0, 0, 1, 0, 0, 0, -1.0]),
            "decode_head.linear_c.0.proj.weight": torch.eye(8),
            "decode_head.linear_fuse.weight": fuse,
            "decode_head.classifier.weight": SHARPNESS * torch.cat([corners, -corners], 1)[..., None, None],
        },
    )
    return folder


def corners_of_classes() -> np.ndarray:
    """Return v = (r, g, b, 1) of each class (C, 4), colours from -1 to 1."""
    return np.array([[*(2 * c / 255 - 1 for c in colour), 1] for colour in COLOURS.values()])


def scale_weights(folder: Path, names: Sequence[str], factor: float) -> None:
    """Multiply the tensors of a saved model whose names contain one of `names`."""
    from safetensors.torch import load_file, save_file

    path = folder / "model.safetensors"
    tensors = load_file(path)
    chosen = {key for key in tensors if any(name in key for name in names)}
    assert chosen
    save_file(
        {key: tensor * (factor if key in chosen else 1) for key, tensor in tensors.items()}, path, {"format": "pt"}
    )


def set_weights(folder: Path, weights: dict[str, Any]) -> None:
    """Set tensors of a saved model, and all others but those of normalisation to 0."""
    from safetensors.torch import load_file, save_file

    path = folder / "model.safetensors"
    tensors = {name: tensor if "norm" in name else tensor * 0 for name, tensor in load_file(path).items()}
    for name, tensor in weights.items():
        assert tensors[name].shape == tensor.shape, name
        tensors[name] = tensor.contiguous()
    save_file(tensors, path, {"format": "pt"})


def class_probability(label: str) -> float:
    """Return the probability that the semantic network gives to a class at a pixel of its colour."""
    corners = corners_of_classes()
    logits = SHARPNESS * corners @ corners[list(COLOURS).index(label)]  # v / |v| times 2 is v, since |v| is 2
    odds = np.exp(logits - logits.max())
    return float(odds[list(COLOURS).index(label)] / odds.sum())


def swin() -> Any:
    return transformers.SwinConfig(
        image_size=SIDE_PX,
        patch_size=4,
        embed_dim=8,
        depths=[1] * 4,
        num_heads=[1] * 4,
        window_size=4,
        out_features=["stage1", "stage2", "stage3", "stage4"],
    )


def resnet(stages: Sequence[int] = (4,)) -> dict[str, Any]:
    return {
        "embedding_size": 8,
        "hidden_sizes": [8] * 4,
        "depths": [1] * 4,
        "layer_type": "basic",
        "out_features": [f"stage{stage}" for stage in stages],
    }


MASKED = {
    "encoder_feedforward_dim": 16,
    "dim_feedforward": 16,
    "encoder_layers": 1,
    "decoder_layers": 2,
    "num_attention_heads": 2,
    "num_queries": 6,
    "hidden_dim": 32,
    "train_num_points": 16,
}
DETR = {
    "d_model": 16,
    "encoder_layers": 1,
    "decoder_layers": 1,
    "encoder_ffn_dim": 16,
    "decoder_ffn_dim": 16,
    "encoder_attention_heads": 2,
    "decoder_attention_heads": 2,
    "num_queries": 6,
}
LABELS = ("chair", "wall", "dining table", "windowpane, window", "robot arm")


def mask2former(folder: Path) -> Path:
    config = transformers.Mask2FormerConfig(
        backbone_config=swin(), feature_size=32, mask_feature_size=32, **MASKED, **with_labels(LABELS)
    )
    return save(
        folder,
        transformers.Mask2FormerForUniversalSegmentation(config),
        transformers.Mask2FormerImageProcessorPil(size=SIZE),
    )


def maskformer(folder: Path) -> Path:
    config = transformers.MaskFormerConfig(
        backbone_config=swin(),
        decoder_config=transformers.DetrConfig(**{**DETR, "d_model": 32}),
        fpn_feature_size=32,
        mask_feature_size=32,
        **with_labels(LABELS),
    )
    return save(
        folder,
        transformers.MaskFormerForInstanceSegmentation(config),
        transformers.MaskFormerImageProcessorPil(size=SIZE),
    )


def oneformer(folder: Path) -> Path:
    config = transformers.OneFormerConfig(
        backbone_config=swin(),
        conv_dim=32,
        mask_dim=32,
        query_dec_layers=1,
        text_encoder_width=32,
        text_encoder_num_layers=1,
        text_encoder_vocab_size=64,
        is_training=False,
        num_classes=len(LABELS),
        **MASKED,
        **with_labels(LABELS),
    )
    image_processor = transformers.OneFormerImageProcessorPil(size=SIZE)
    # As published: the processor names a file of its data set, which it would download.
    image_processor.repo_path, image_processor.class_info_file = "shi-labs/oneformer_demo", "ade20k_panoptic.json"
    processor = transformers.OneFormerProcessor(image_processor=image_processor, tokenizer=clip_tokenizer())
    return save(folder, transformers.OneFormerForUniversalSegmentation(config), processor)


def detr_config(**settings: Any) -> Any:
    return transformers.DetrConfig(
        use_timm_backbone=False,
        backbone=None,
        use_pretrained_backbone=False,
        backbone_config=transformers.ResNetConfig(**resnet((1, 2, 3, 4))),
        **{**DETR, **settings},
        **with_labels(LABELS),
    )


def detr(folder: Path) -> Path:
    return save(
        folder,
        transformers.DetrForObjectDetection(detr_config()),
        transformers.DetrImageProcessorPil(size={"shortest_edge": SIDE_PX, "longest_edge": 96}),
    )


def detr_panoptic(folder: Path) -> Path:
    config = detr_config(d_model=128, encoder_attention_heads=8, decoder_attention_heads=8)
    return save(
        folder,
        transformers.DetrForSegmentation(config),
        transformers.DetrImageProcessorPil(size={"shortest_edge": SIDE_PX, "longest_edge": 96}),
    )


def rt_detr(folder: Path) -> Path:
    config = transformers.RTDetrConfig(
        backbone_config=transformers.RTDetrResNetConfig(**resnet((2, 3, 4))),
        encoder_hidden_dim=16,
        encoder_in_channels=[8] * 3,
        encoder_ffn_dim=16,
        encoder_attention_heads=2,
        d_model=16,
        decoder_in_channels=[16] * 3,
        num_queries=6,
        decoder_layers=1,
        decoder_ffn_dim=16,
        decoder_attention_heads=2,
        num_denoising=0,
        **with_labels(LABELS),
    )
    return save(folder, transformers.RTDetrForObjectDetection(config), transformers.RTDetrImageProcessorPil(size=SIZE))


def clip_tokenizer() -> Any:
    """A tokenizer with one token for each letter."""
    letters = [chr(code) for code in range(ord("a"), ord("z") + 1)]
    vocabulary = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    return transformers.CLIPTokenizer(vocab={token: i for i, token in enumerate(vocabulary)}, merges=[])


def owlv2(folder: Path) -> Path:
    layers = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2}
    tokens = {
        "vocab_size": 64,
        "max_position_embeddings": 32,
        "pad_token_id": 0,
        "bos_token_id": 52,
        "eos_token_id": 53,
    }
    config = transformers.Owlv2Config(
        text_config={**layers, **tokens},
        vision_config={**layers, "image_size": SIDE_PX, "patch_size": 16},
        projection_dim=16,
    )
    processor = transformers.Owlv2Processor(transformers.Owlv2ImageProcessorPil(size=SIZE), clip_tokenizer())
    return save(folder, transformers.Owlv2ForObjectDetection(config), processor)


WORDS = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "?", "chair", "table", "office", "plant", "##s")


def grounding_dino(folder: Path, max_text_len: int = 256) -> Path:
    text = transformers.BertConfig(
        vocab_size=len(WORDS),
        hidden_size=16,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=16,
        max_position_embeddings=256,
    )
    backbone = swin()
    backbone.out_features = ["stage2", "stage3", "stage4"]
    config = transformers.GroundingDinoConfig(
        backbone_config=backbone,
        text_config=text,
        **{**DETR, "d_model": 32, "decoder_layers": 2},
        max_text_len=max_text_len,
    )
    tokenizer = transformers.BertTokenizer(vocab={word: i for i, word in enumerate(WORDS)})
    side = {"height": 2 * SIDE_PX, "width": 2 * SIDE_PX}
    processor = transformers.GroundingDinoProcessor(transformers.GroundingDinoImageProcessorPil(size=side), tokenizer)
    return save(folder, transformers.GroundingDinoForObjectDetection(config), processor)


def random_weights(make: Callable[[Path], Path], folder: Path, seed: int = 0) -> Path:
    """Save a model with random weights that depend on the seed only."""
    torch.manual_seed(seed)
    return make(folder)


def edit_config(folder: Path, **changes: Any) -> None:
    """Change entries of a model's config.json; None removes an entry."""
    path = folder / "config.json"
    content = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({name: value for name, value in content.items() if value is not None}))


GAIN, OFFSET = 0.5, 1.0
"""Output of the depth networks with known answers: see `dpt` and `depth_anything`."""
MAX_DEPTH_M = 8


def dpt(folder: Path) -> Path:
    """DPT whose output, an inverse depth, is GAIN * v + OFFSET, where v is the mean red of a patch of 16 pixels, from
    -1 to 1."""
    config = transformers.DPTConfig(
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        intermediate_size=16,
        image_size=SIDE_PX,
        patch_size=16,
        backbone_out_indices=[0, 1, 2, 3],
        neck_hidden_sizes=[8] * 4,
        fusion_hidden_size=8,
        readout_type="ignore",
        is_hybrid=False,
    )
    save(folder, transformers.DPTForDepthEstimation(config), depth_processor())
    names = ("dpt.embeddings.patch_embeddings.projection", "head.head.0", "head.head.2", "head.head.4")
    set_weights(folder, pass_red(folder, *names, gain=GAIN, offset=OFFSET))
    return folder


def depth_anything(folder: Path, metric: bool = False) -> Path:
    """Depth Anything with a known output for the mean red v of a patch of 4 pixels, from -1 to 1, as the function
    `depth_output` states.

    The patch embedding is (v, 1, -v, -1, 0, ...), which layer normalisation scales.
    """
    backbone = transformers.Dinov2Config(
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        image_size=SIDE_PX,
        patch_size=4,
        out_features=["stage1", "stage2", "stage3", "stage4"],
        reshape_hidden_states=False,
        apply_layernorm=True,
    )
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=16,
        neck_hidden_sizes=[8] * 4,
        fusion_hidden_size=8,
        head_hidden_size=8,
        patch_size=4,
        depth_estimation_type="metric" if metric else "relative",
        max_depth=MAX_DEPTH_M if metric else 1,
    )
    save(folder, transformers.DepthAnythingForDepthEstimation(config), depth_processor())
    names = ("backbone.embeddings.patch_embeddings.projection", "head.conv1", "head.conv2", "head.conv3")
    set_weights(folder, pass_red(folder, *names, gain=GAIN, offset=OFFSET))
    return folder


def metric_depth_anything(folder: Path) -> Path:
    return depth_anything(folder, metric=True)


def depth_output(red: np.ndarray | float, metric: bool) -> np.ndarray:
    """Return the output of `depth_anything` for a red from 0 to 255: inverse depth, or z-depth in metres if metric."""
    v = 2 * np.asarray(red, float) / 255 - 1
    value = GAIN * v / np.sqrt((v**2 + 1) / 8 + 1e-6) + OFFSET
    return MAX_DEPTH_M / (1 + np.exp(-value)) if metric else np.maximum(value, 0)


def pass_red(
    folder: Path, embedding: str, first: str, second: str, last: str, *, gain: float, offset: float
) -> dict[str, Any]:
    """Return the weights of a dense prediction transformer that pass channel 0 from the finest stage to the output.

    All blocks add 0. The head adds 10 before its rectifier, and subtracts it after.
    """
    from safetensors.torch import load_file

    shapes = {name: tensor.shape for name, tensor in load_file(folder / "model.safetensors").items()}
    weights = {f"{embedding}.weight": torch.zeros(shapes[f"{embedding}.weight"])}
    pixels = shapes[f"{embedding}.weight"][2] ** 2
    weights[f"{embedding}.weight"][0, 0] = 1 / pixels
    weights[f"{embedding}.weight"][2, 0] = -1 / pixels
    weights[f"{embedding}.bias"] = torch.tensor([0, 1, 0, -1.0] + [0] * 12)

    def identity(name: str, scale: float = 1.0) -> None:
        """Let channel 0 pass at the centre of a convolution's kernel, or to all pixels of a transposed one's."""
        weights[name] = torch.zeros(shapes[name])
        if "resize" in name:
            weights[name][0, 0] = scale
        else:
            weights[name][0, 0, shapes[name][2] // 2, shapes[name][3] // 2] = scale

    for name in ("reassemble_stage.layers.0.projection", "reassemble_stage.layers.0.resize", "convs.0"):
        identity(f"neck.{name}.weight")
    identity("neck.fusion_stage.layers.3.projection.weight")
    identity(f"{first}.weight")
    identity(f"{second}.weight", gain)
    identity(f"{last}.weight")
    lift = torch.zeros(shapes[f"{second}.bias"])
    lift[0] = 10
    weights[f"{second}.bias"], weights[f"{last}.bias"] = lift, torch.tensor([offset - 10])
    return weights


def depth_processor() -> Any:
    return transformers.DPTImageProcessorPil(size=SIZE, ensure_multiple_of=4, keep_aspect_ratio=True, **HALF)


def zoedepth(folder: Path) -> Path:
    backbone = transformers.BeitConfig(
        hidden_size=16,
        num_hidden_layers=4,
        num_attention_heads=2,
        intermediate_size=16,
        image_size=SIDE_PX,
        patch_size=16,
        out_features=["stage1", "stage2", "stage3", "stage4"],
        reshape_hidden_states=False,
        use_relative_position_bias=True,
    )
    config = transformers.ZoeDepthConfig(
        backbone_config=backbone,
        neck_hidden_sizes=[8] * 4,
        fusion_hidden_size=8,
        bottleneck_features=8,
        num_relative_features=8,
        bin_embedding_dim=8,
        num_attractors=[4, 2, 2, 1],
        bin_configurations=[{"name": "nyu", "n_bins": 8, "min_depth": 1e-3, "max_depth": 10.0}],
    )
    processor = transformers.ZoeDepthImageProcessorPil(size=SIZE, ensure_multiple_of=32)
    return save(folder, transformers.ZoeDepthForDepthEstimation(config), processor)


def glpn(folder: Path) -> Path:
    config = transformers.GLPNConfig(
        depths=[1] * 4,
        hidden_sizes=[8] * 4,
        num_attention_heads=[1] * 4,
        sr_ratios=[16, 8, 4, 2],
        mlp_ratios=[1] * 4,
        decoder_hidden_size=8,
        max_depth=10,
    )
    return save(folder, transformers.GLPNForDepthEstimation(config), transformers.GLPNImageProcessorPil())

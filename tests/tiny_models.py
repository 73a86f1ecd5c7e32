"""Small models of the architectures of `transformers`, in the official format: a folder with config.json,
model.safetensors and the files of the image processor and the tokenizer.

The answers of the semantic network are known in closed form. The others have random weights.
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

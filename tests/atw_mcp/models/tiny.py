"""Model folders for tests: transformers models with few random weights, and commands of known output."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

TRACKER = {
    "prompt_encoder_config": {"hidden_size": 128, "mask_input_channels": 4},
    "mask_decoder_config": {
        "hidden_size": 128,
        "mlp_dim": 32,
        "num_attention_heads": 2,
        "iou_head_hidden_dim": 16,
    },
    "memory_attention_hidden_size": 128,
    "memory_attention_num_layers": 1,
    "memory_attention_feed_forward_hidden_size": 32,
    "memory_attention_rope_feat_sizes": [8, 8],
    "memory_encoder_hidden_size": 128,
    "memory_encoder_output_channels": 64,  # fixed in the memory attention of the library
    "mask_downsampler_embed_dim": 128,
    "memory_fuser_embed_dim": 128,
    "memory_fuser_intermediate_dim": 32,
    "memory_fuser_num_layers": 1,
}


def libraries() -> tuple[Any, Any]:
    """torch and transformers; the test is skipped where the extra is not installed."""
    reason = "needs the extra: pip install 'atw-mcp[models]'"
    return pytest.importorskip("torch", reason=reason), pytest.importorskip("transformers", reason=reason)


def sam2(folder: Path) -> Path:
    """SAM 2 for video at 128 x 128, biased to say that its objects are there."""
    torch, transformers = libraries()
    torch.manual_seed(0)
    backbone = {
        "model_type": "sam2_hiera_det_model",
        "hidden_size": 8,
        "image_size": [128, 128],
        "embed_dim_per_stage": [8, 16, 32, 64],
        "num_attention_heads_per_stage": [1, 2, 4, 8],
        "blocks_per_stage": [1, 1, 2, 1],
        "global_attention_blocks": [3],
    }
    vision = transformers.Sam2VisionConfig(
        backbone_config=backbone,
        backbone_channel_list=[64, 32, 16, 8],
        backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
        fpn_hidden_size=128,
    )
    prompt = {**TRACKER["prompt_encoder_config"], "image_size": 128, "patch_size": 16}
    config = transformers.Sam2VideoConfig(
        vision_config=vision.to_dict(), image_size=128, **{**TRACKER, "prompt_encoder_config": prompt}
    )
    return _saved(transformers.Sam2VideoModel(config), folder)


def sam3(folder: Path) -> Path:
    """The tracker of SAM 3 at 112 x 112."""
    torch, transformers = libraries()
    torch.manual_seed(0)
    backbone = {
        "model_type": "sam3_vit_model",
        "hidden_size": 32,
        "intermediate_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": 112,
        "patch_size": 14,
        "window_size": 4,
        "global_attn_indexes": [1],
        "pretrain_image_size": 56,
    }
    vision = {
        "model_type": "sam3_vision_model",
        "backbone_config": backbone,
        "fpn_hidden_size": 128,
        "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
    }
    prompt = {**TRACKER["prompt_encoder_config"], "image_size": 112, "patch_size": 14}
    config = transformers.Sam3TrackerVideoConfig(
        vision_config=vision, image_size=112, **{**TRACKER, "prompt_encoder_config": prompt}
    )
    return _saved(transformers.Sam3TrackerVideoModel(config), folder)


def _saved(network: Any, folder: Path) -> Path:
    torch, _ = libraries()
    with torch.no_grad():  # random weights say of every object that it is not there, and then give no mask
        network.mask_decoder.pred_obj_score_head.proj_out.bias.fill_(4.0)
    network.save_pretrained(str(folder))
    return folder


def depth_anything(folder: Path, kind: str = "metric") -> Path:
    """Depth Anything at 56 x 56."""
    torch, transformers = libraries()
    torch.manual_seed(0)
    backbone = {
        "model_type": "dinov2",
        "hidden_size": 16,
        "num_hidden_layers": 4,
        "num_attention_heads": 2,
        "image_size": 56,
        "patch_size": 14,
        "out_indices": [1, 2, 3, 4],
        "reshape_hidden_states": False,
    }
    config = transformers.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=16,
        neck_hidden_sizes=[8, 8, 16, 16],
        fusion_hidden_size=8,
        head_hidden_size=8,
        depth_estimation_type=kind,
        max_depth=20,
    )
    transformers.DepthAnythingForDepthEstimation(config).save_pretrained(str(folder))
    size = {"size": {"height": 56, "width": 56}, "keep_aspect_ratio": True, "ensure_multiple_of": 14}
    (folder / "preprocessor_config.json").write_text(json.dumps(size))
    return folder


def depth_pro(folder: Path) -> Path:
    """Depth Pro at 128 x 128."""
    torch, transformers = libraries()
    torch.manual_seed(0)
    vit = {
        "model_type": "dinov2",
        "hidden_size": 16,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": 32,
        "patch_size": 8,
    }
    config = transformers.DepthProConfig(
        image_model_config=vit,
        patch_model_config=vit,
        fov_model_config=vit,
        patch_size=32,
        fusion_hidden_size=16,
        intermediate_hook_ids=[1, 0],
        intermediate_feature_dims=[8, 8],
        scaled_images_feature_dims=[8, 8, 8],
        use_fov_model=True,
    )
    transformers.DepthProForDepthEstimation(config).save_pretrained(str(folder))
    (folder / "preprocessor_config.json").write_text(json.dumps({"size": {"height": 128, "width": 128}}))
    return folder


def command(folder: Path, task: str, script: str, **more: object) -> Path:
    """A model that is a Python script; `source` and `target` are its folders."""
    folder.mkdir(parents=True)
    head = "import json, sys, pathlib\nsource, target = map(pathlib.Path, sys.argv[1:])\n"
    head += "request = json.loads((source / 'request.json').read_text())\n"
    (folder / "run.py").write_text(head + script)
    manifest = {"task": task, "command": [sys.executable, "run.py"], "license": "test-1.0", **more}
    (folder / "model.json").write_text(json.dumps(manifest))
    return folder

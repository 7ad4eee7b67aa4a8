"""What is found under ATW_MODELS, and what is said where something is missing."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from atw_mcp.models import Limits, ModelError, available, find_model, open_folder
from atw_mcp.models.running import check_memory, extra


def folder(root: Path, name: str, config: dict[str, Any]) -> Path:
    (root / name).mkdir(parents=True)
    (root / name / "config.json").write_text(json.dumps(config))
    (root / name / "model.safetensors").write_bytes(b"0" * 1000)
    return root / name


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ATW_MODELS", str(tmp_path))
    return tmp_path


def test_the_licence_comes_from_manifest_card_config_or_file(root: Path) -> None:
    plain = folder(root, "plain", {"model_type": "sam2_video"})
    assert open_folder(plain).licence == "unknown"
    (plain / "LICENSE").write_text("\n  Apache License\nVersion 2.0\n")
    assert open_folder(plain).licence == "Apache License (LICENSE)"
    (plain / "README.md").write_text("---\nlicense: apache-2.0\ntags: [a]\n---\nlicense: not this\n")
    assert open_folder(plain).licence == "apache-2.0"
    (plain / "config.json").write_text(json.dumps({"model_type": "sam2_video", "license": "other"}))
    assert open_folder(plain).licence == "other"


def test_models_are_listed_with_the_reason_why_a_folder_is_none(root: Path) -> None:
    folder(root, "sam", {"model_type": "sam2_video"})
    folder(root, "bert", {"model_type": "bert"})
    folder(root, "relative", {"model_type": "depth_anything"})
    (folder(root, "bare", {"model_type": "depth_pro"}) / "model.safetensors").unlink()
    found, refused = available()
    assert [(m.name, m.task) for m in found] == [("sam", "segmentation")]
    assert any("'bert'" in text and "sam2_video" in text for text in refused)
    assert any("unknown scale" in text for text in refused)
    assert any("no weights" in text and "safetensors" in text for text in refused)


def test_a_missing_model_says_where_to_put_it(root: Path) -> None:
    with pytest.raises(ModelError, match="there is none") as caught:
        find_model("sam2")
    assert str(root) in str(caught.value)
    assert "ATW_MODELS" in str(caught.value)
    folder(root, "sam", {"model_type": "sam2_video"})
    with pytest.raises(ModelError, match=r"models: \['sam'\]"):
        find_model("../sam")


def test_the_hash_follows_the_weights(root: Path) -> None:
    path = folder(root, "sam", {"model_type": "sam2_video"})
    before = open_folder(path).sha256()
    assert before == open_folder(path).sha256()
    (path / "model.safetensors").write_bytes(b"1" * 1001)
    assert open_folder(path).sha256() != before


def test_a_missing_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ModelError, match=r"torch.*pip install 'atw-mcp\[models\]'"):
        extra("torch")


def test_a_server_starts_without_loading_the_extra() -> None:
    check = "import sys, atw_mcp.server; sys.exit(any(m in sys.modules for m in ('torch', 'transformers')))"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0


def test_limits_come_from_the_environment(monkeypatch: pytest.MonkeyPatch, root: Path) -> None:
    monkeypatch.setenv("ATW_MODELS_BATCH", "2")
    monkeypatch.setenv("ATW_MODELS_DEVICE", "cpu")
    monkeypatch.setenv("ATW_MODELS_MEMORY_GB", "1e-6")
    limits = Limits.from_environment()
    assert limits == Limits("cpu", 2, 1e-6)
    model = open_folder(folder(root, "sam", {"model_type": "sam2_video"}))
    with pytest.raises(ModelError, match="ATW_MODELS_MEMORY_GB"):
        check_memory(model, limits, 0)
    check_memory(model, Limits("cpu", 2, 1.0), 1024 * 1024)
    with pytest.raises(ModelError, match=r"0\.84 GB"):
        check_memory(model, Limits("cpu", 2, 0.5), 1024 * 1024)
    monkeypatch.setenv("ATW_MODELS_BATCH", "0")
    with pytest.raises(ModelError, match="ATW_MODELS_BATCH"):
        Limits.from_environment()

"""The option `--device`: named as the engine reads it, and refused where the machine has no such device."""

from __future__ import annotations

import argparse

import pytest

from atw_mcp import device_option
from polyworld.core import buffers


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser()
    device_option.add_device(made)
    return made


def test_the_device_reaches_the_engine_of_a_server_by_the_variable_it_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(buffers.VARIABLE, "cuda:7")
    parser().parse_args(["--device", "cpu"])
    assert device_option.os.environ[buffers.VARIABLE] == "cpu"


def test_a_device_that_is_not_there_ends_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        parser().parse_args(["--device", "tpu"])
    assert "no device 'tpu'; this machine has cpu" in capsys.readouterr().err

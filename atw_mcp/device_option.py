"""The option `--device`: where worlds are simulated."""

from __future__ import annotations

import argparse
import os

VARIABLE = "POLYWORLD_DEVICE"  # read where the engine is first imported, in this process or in a server it starts


def add_device(parser: argparse.ArgumentParser) -> None:
    """Add `--device` to a command that simulates worlds, or starts a server that does."""
    parser.add_argument(
        "--device",
        action=_Choose,
        metavar="DEVICE",
        help="where rigid bodies are simulated: cpu (the default), cuda, ...; worlds with liquids, ropes, cloth or "
        "soft bodies stay on the CPU",
    )


class _Choose(argparse.Action):
    """Refuses a device that Warp does not find; only `cpu` is known without loading it."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, *_: object
    ) -> None:
        name = str(values)
        before = os.environ.get(VARIABLE, "cpu")
        os.environ[VARIABLE] = name  # read as the engine is imported, which then says whether there is a driver
        if name != "cpu":
            try:
                from polyworld.core import buffers

                buffers.use_device(name)
            except ValueError as error:
                os.environ[VARIABLE] = before
                parser.error(str(error))
        namespace.device = name

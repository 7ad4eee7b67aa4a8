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
        help="where rigid bodies and liquids are simulated: cpu (the default), cuda, ...; other worlds stay on the CPU",
    )


class _Choose(argparse.Action):
    """Refuses a device that Warp does not find; only `cpu` is known without loading it."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: object, *_: object
    ) -> None:
        name = str(values)
        if name != "cpu":
            from polyworld.core import buffers

            try:
                buffers.use_device(name)
            except ValueError as error:
                parser.error(str(error))
        os.environ[VARIABLE] = name
        namespace.device = name

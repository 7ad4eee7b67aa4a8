"""Random small files of MJCF, URDF and USD, imported: `python -m tests.benchmarks.fuzz.imports [COUNT] [FIRST]`.

COUNT (1000) files from the seed FIRST (0) on, each in a confined process of its own. None may take more than 10 s of
processor time or 1 GB: the reader answers, refuses, or is ended. Both are watched from outside, every few milliseconds,
so that a file that ends its reader counts as well; a thousand files take some ten minutes. Linux only.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from contextlib import suppress
from multiprocessing import forkserver
from pathlib import Path

from tests.polyworld.exchange.random_files import outcome, write

SECONDS, MEMORY = 10.0, 1_000_000_000
LOOK = 0.005  # seconds between two looks at the readers


class Watch(threading.Thread):
    """Looks at the processes that read: processor time [s] and greatest memory [bytes] of each, by its number."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.seconds: dict[int, float] = defaultdict(float)
        self.memory: dict[int, int] = defaultdict(int)

    def run(self) -> None:
        """Look until the program ends."""
        while True:
            server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
            with suppress(OSError, ValueError, IndexError):
                for child in Path(f"/proc/{server}/task/{server}/children").read_text().split():
                    self._look(int(child))
            time.sleep(LOOK)

    def _look(self, child: int) -> None:
        spent = Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[11:13]
        status = Path(f"/proc/{child}/status").read_text()
        self.seconds[child] = sum(map(int, spent)) / os.sysconf("SC_CLK_TCK")
        self.memory[child] = 1024 * int(status.split("VmHWM:")[1].split()[0])


def main() -> None:
    """Import files and print how they ended, and the most that one of them took."""
    given = [int(argument) for argument in sys.argv[1:]]
    count, first = (*given, *(1000, 0)[len(given) :])
    ended: Counter[str] = Counter()
    costly: list[tuple[float, str]] = []
    watch = Watch()
    watch.start()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            path = write(Path(folder), seed)
            before = len(watch.seconds)
            ended[f"{path.suffix[1:]:5s} {outcome(path)}"] += 1
            costly += [(spent, path.name) for spent in list(watch.seconds.values())[before:]]
    for text, number in ended.most_common(40):
        print(f"{number:5d}  {text}")
    longest, at = max(costly)
    most = max(watch.memory.values())
    print(f"{count} files, {len(costly)} seen at work; longest {longest:.1f} s ({at}), most memory {most / 1e9:.2f} GB")
    sys.exit(longest > SECONDS or most > MEMORY)


if __name__ == "__main__":
    main()

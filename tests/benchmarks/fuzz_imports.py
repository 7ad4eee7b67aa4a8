"""Random small files of MJCF, URDF and USD, imported: `python -m tests.benchmarks.fuzz_imports [COUNT] [FIRST]`.

None may take more than 10 s or 1 GB: the reader answers, refuses, or is ended. Processor time and memory are those of
the reading process, with its start.
"""

from __future__ import annotations

import resource
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.polyworld.exchange.random_files import outcome, write

SECONDS, MEMORY = 10.0, 1_000_000_000


def main() -> None:
    """Import files and print how they ended, and the most that one of them took."""
    given = [int(argument) for argument in sys.argv[1:]]
    count, first = (*given, *(1000, 0)[len(given) :])
    ended: Counter[str] = Counter()
    longest, at = 0.0, ""
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            path = write(Path(folder), seed)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            ended[outcome(path)] += 1
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            longest, at = max((longest, at), (spent, path.name))
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    for text, number in ended.most_common(20):
        print(f"{number:5d}  {text}")
    print(f"{count} files; longest {longest:.1f} s ({at}), most memory {most / 1e9:.2f} GB")
    sys.exit(longest > SECONDS or most > MEMORY)


if __name__ == "__main__":
    main()

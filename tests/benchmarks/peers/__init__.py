"""The engine beside its peers, in one command: `uv run --group bench python -m tests.benchmarks.peers`.

Each section is a module with a function `tables(quick) -> list[Table]`.
"""

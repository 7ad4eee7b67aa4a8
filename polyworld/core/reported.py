"""Results as a person at a prompt, in a notebook or in a script reads them."""

from __future__ import annotations

from abc import abstractmethod
from html import escape
from typing import Any

import numpy as np


class Reported:
    """A result that summarises itself in a few lines: at a prompt as text, in a notebook as a table."""

    @abstractmethod
    def summary(self) -> str:
        """Return a line that says what it is, then lines `  name: what is said of it`."""

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        caption, *lines = (escape(line) for line in self.summary().splitlines())
        rows = "".join(
            f"<tr><td>{name.strip()}</td><td>{said}</td></tr>"
            for name, _, said in (line.partition(": ") for line in lines)
        )
        return f"<table><caption>{caption}</caption>{rows}</table>"


def json_ready(value: Any) -> Any:
    """Replace tuples and arrays by lists, and numbers that are not finite by None."""
    if isinstance(value, dict):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value

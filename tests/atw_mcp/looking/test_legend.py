"""Legends below pictures: as wide as they, every mark drawn in its colour, in as many rows as it takes."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.looking.legend import ROW, Entry, Mark, arrow, cross, dot, legend, line, star
from atw_mcp.looking.overlay import Color

BLUE: Color = (233, 180, 86)


@pytest.mark.parametrize(
    "mark", [line(BLUE), line(BLUE, "dashed"), line(BLUE, thin=True), arrow(BLUE), dot(BLUE), star(BLUE), cross(BLUE)]
)
def test_marks_are_drawn_in_their_colour_in_front_of_the_words(mark: Mark) -> None:
    drawn = legend([Entry("words", mark)], 400)
    assert drawn.shape == (ROW, 400, 3)
    colored = np.abs(drawn.astype(int) - np.array(BLUE)).max(axis=2) < 90
    assert 5 < colored[:, :42].sum() < 400  # the words begin there, in white
    assert (drawn[:, 42:] > 200).all(axis=2).sum() > 5

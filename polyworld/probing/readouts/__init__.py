"""Readouts of deformable objects: what a rollout shows of them, in the form in which it can be observed."""

from polyworld.probing.readouts.kinds import (
    Amount,
    Centreline,
    Curve,
    Front,
    GridOccupancy,
    ImageOccupancy,
    Level,
    Markers,
    Outline,
    Readout,
    Stretch,
    Tension,
)
from polyworld.probing.readouts.read import check_readable, read

__all__ = [
    "Amount",
    "Centreline",
    "Curve",
    "Front",
    "GridOccupancy",
    "ImageOccupancy",
    "Level",
    "Markers",
    "Outline",
    "Readout",
    "Stretch",
    "Tension",
    "check_readable",
    "read",
]

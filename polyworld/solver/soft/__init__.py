"""Soft bodies: elastic, viscous and plastic forces of quadratic tetrahedra and triangles."""

from polyworld.solver.soft.stage import SoftStage

__all__ = ["SoftStage"]

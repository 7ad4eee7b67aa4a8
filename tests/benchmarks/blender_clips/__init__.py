"""Clips of the physics of `tests.benchmarks.video_clips`, filmed by Blender's path tracer (SI units, z up)."""

"""Estimate a world's unknowns from recorded motion: multiple shooting, block-bordered least squares, noise.

Reading order: unknown, segments, problem, forward, normal_equations, shooting.
"""

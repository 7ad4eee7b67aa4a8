"""Estimate a world's unknowns and initial states from recorded motion, by least squares on simulated trajectories.

Reading order: unknown, design (states), batch and comparing (forward), noise, normal_equations, descent, profile,
refitting; hypothesis, fit_context, score_test, intervals, goodness; segments; world_fit for the tracks of one video.
"""

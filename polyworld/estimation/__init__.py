"""Estimate a world's unknowns and initial states from recorded motion, by least squares on simulated trajectories.

Reading order: fit, study, unknown, declared, stretches, states (support, linkage), problem (readout, machines),
least_squares, posterior, accuracy, whole_run; search for comparison. `gap` uses the same unknown, noise, states,
readout, problem and least_squares.
"""

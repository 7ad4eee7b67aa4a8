"""Estimate a world's unknowns and initial states from recorded motion, by least squares on simulated trajectories.

Reading order: fit, study, unknown, declared, stretches, starts, problem (readout, machines), least_squares, posterior,
predict, whole_run; search and cem for comparison. `gap` uses the same problem and least_squares with noise, readout,
rotation_counting and states (initial_state, initial_support, linkage).
"""

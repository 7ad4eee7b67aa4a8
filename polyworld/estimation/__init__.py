"""Estimate a world's unknowns and initial states from recorded motion, by least squares on simulated trajectories.

Reading order of the core: fit, study, unknown, declared, stretches, starts, problem (readout, machines), least_squares,
posterior, predict, whole_run; search and cem for comparison. `gap_new` stands on it with run_readout and run_noise.
What `gap` still uses, and goes with it: design (states), batch and comparing (forward), noise, normal_equations,
descent, profile, refitting; hypothesis, fit_context, score_test, intervals, goodness; segments.
"""

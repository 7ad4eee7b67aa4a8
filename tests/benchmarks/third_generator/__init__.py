"""A third, independent generator of measured data with a missing effect; SciPy's solve_ivp is its only simulator."""

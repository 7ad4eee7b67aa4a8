"""Questions about rollouts: predicates, readouts, comparisons, ensembles.

Read `predicates`, `query` and `margins`, then `closest_approach`, `compare`, `readouts`, and last `ensemble`.
"""

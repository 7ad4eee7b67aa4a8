"""Questions about rollouts: predicates, readouts, comparisons, ensembles.

Read `predicates` (the forms of statements), `margins` (decides each statement about a state, such as taut or above, and
by how much) and `query` (over an interval of a rollout), then `closest_approach`, `compare`, `readouts`, and last
`ensemble`.
"""

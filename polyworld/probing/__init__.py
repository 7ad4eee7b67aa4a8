"""Questions about rollouts: predicates, readouts, comparisons, ensembles.

Read `predicates` (the forms of statements), `query` (whether one holds) and `margins` (by how much), then
`closest_approach`, `compare`, `readouts`, and last `ensemble`.
"""

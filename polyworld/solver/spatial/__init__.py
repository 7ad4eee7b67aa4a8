"""Six-degree-of-freedom rigid bodies: one file a stage.

Read `step` first, the page that reads like the algorithm; then `contacts`, `impacts` (rebound and friction) and
`constraints`.
"""

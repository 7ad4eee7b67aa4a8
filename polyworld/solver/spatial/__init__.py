"""Six-degree-of-freedom rigid bodies: one file a stage, `step.py` is the page that reads like the algorithm."""

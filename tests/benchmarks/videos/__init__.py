"""Perception of rendered clips, scored against true masks: see `__main__`."""

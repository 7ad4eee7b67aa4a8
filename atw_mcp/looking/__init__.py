"""Pictures for agents: overlays on frames, plans, strips of residuals.

Read `overlay` first.
"""

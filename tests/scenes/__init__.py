"""Scenes whose motion is known: simulated by independent code, in closed form, or annotated by others."""

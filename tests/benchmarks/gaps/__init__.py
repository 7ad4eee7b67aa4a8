"""Verdicts of `polyworld.gap` on data with known answers: real sets, four generators, and materials."""

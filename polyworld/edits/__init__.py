"""Interventions: edits of a world that make a branch of it.

Read `interventions` first; `removal` and `relocation` carry along what hangs on an object.
"""

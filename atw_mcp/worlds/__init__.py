"""Worlds of a case: built from observations and parts, checked, rolled out and kept.

Read `building` and `rollouts` first.
"""

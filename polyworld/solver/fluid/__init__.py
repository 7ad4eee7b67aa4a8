"""Incompressible free-surface liquids: particles that carry them, a staggered grid that keeps them incompressible.

Read `step` first, one sub-step launch by launch; then `transfer`, `pressure`, `viscosity` and `motion`.
"""

"""Faults of a world that are no law: its numbers, what nobody sees in it, joints, materials, the observer.

Each module lists its candidates in `CANDIDATES` and is found by itself; modules without that list serve others.
"""

"""Ropes: stretch solved implicitly and directly, bending and twist explicitly, pulleys within the stretch solve."""

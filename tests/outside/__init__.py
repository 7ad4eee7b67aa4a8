"""Judges from outside: the official conformance suite, the Inspector, and random calls over the published schemas."""

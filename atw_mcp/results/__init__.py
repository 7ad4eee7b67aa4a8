"""Results of tools as models: one module for each module of `atw_mcp/tools`, from which output schemas are made.

Each field has a type, a unit where it has one, and a description. Numbers that may be missing are `float | None`:
NaN reaches an agent as null.
"""

"""The gap workflow as agents and the command line see it: its work, its words, its pictures.

Read `work` and `words` first, then `command`.
"""

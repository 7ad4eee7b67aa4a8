"""How messages reach the server and leave it: limits, lines on stdio, and the end of a process.

Read `limits` first, then `messages` and `lines` (stdio) and `ending` (signals).
"""

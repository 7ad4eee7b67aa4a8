"""What every call passes through: how arguments are read, work is run, and results are shaped.

Read `app` (the state of a server; refuses tools before or after CommitWorld, naming those to call), `toolbox` (how a
tool is registered), `results` and `jobs`; `forms` and `schemas` read and describe arguments.
"""

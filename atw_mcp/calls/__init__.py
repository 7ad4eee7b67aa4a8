"""What every call passes through: how arguments are read, work is run, and results are shaped.

Read `app` (the state of a server), `toolbox` (how a tool is registered), `results` and `jobs`; `forms` and `schemas`
read and describe arguments.
"""

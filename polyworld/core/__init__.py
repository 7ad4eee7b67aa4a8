"""Ground of the engine: settings of Warp, arrays and launches on the device in use, and interruption of computations.

Read `buffers` and `interruption`; `buffers` makes the settings before anything is launched.
"""

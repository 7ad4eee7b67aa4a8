"""Ground of the engine: settings of Warp, arrays and launches on the device in use, and interruption of computations.

Read `buffers` and `interruption`; `warp_settings` is imported before any kernel is made.
"""

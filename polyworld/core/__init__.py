"""Ground of the engine: settings of Warp, and arrays and launches on the device in use.

Read `buffers`; `warp_settings` is imported before any kernel is made.
"""

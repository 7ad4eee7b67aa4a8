"""Cases: a video or a measured data set with its bindings, and where every value came from.

Read `cases` first, then `origins` (where each value of a world came from).
"""

"""Cases: a video or a measured data set with its bindings, and the provenance of every value.

Read `cases` first, then `provenance`.
"""

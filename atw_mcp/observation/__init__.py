"""From a video or a file to an observation of a case: tracks, recordings, shapes.

Read `observing` (videos) and `importing` (files) first; `matching` gives known objects their tracks.
"""

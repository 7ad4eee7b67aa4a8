"""Fits of a world to its tracks: the request, the verdict, and the short path from a video.

Read `fitting` and `verdict` first, then `video_model`.
"""

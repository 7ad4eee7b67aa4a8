"""Measured data: tracks of a video, recordings of runs, series of shapes, and the initial states they show.

Read `tracks` and `recording` first; `recording_csv` reads tables, `initial_states` starts a world as its tracks begin.
"""

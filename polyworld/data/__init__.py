"""Measured data: tracks of a video, recordings of runs, series of shapes, and the initial states they show.

Read `tracks` and `recording` first; `table` reads tables, `recording_csv` recordings from them, `initial_states` starts
a world as its tracks begin.
"""

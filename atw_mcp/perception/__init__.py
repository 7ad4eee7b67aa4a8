"""Perception from plain video: masks and identities, cameras, motion in the world, corrections, importers.

info = probe("clip.mp4")
observation = observe("clip.mp4")                     # masks and names, in pixels
camera = calibrate_from_points(points, pixels, (w, h)).camera
solids = estimate_sizes(observation, camera)
tracks = world_tracks(observation, camera, {n: s.solid for n, s in solids.items()}, seconds_per_frame=0.04)

`video` reads, `observe` finds and follows, `calibration` gives the camera, `tracks` turns masks into places in the
world, `given_places` applies places that are known.
"""

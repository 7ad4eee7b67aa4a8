"""Elastic forces of cloth: membrane, bending, damping and air drag of triangles."""

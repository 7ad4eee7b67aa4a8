"""Records of a simulation: states at sample times, and events.

Read `trajectory` (the records) first, then `events` (which find entries, exits and rest in them).
"""

from polyworld.trajectory.trajectory import BatchTrajectory, Event, PointMotion, Rollout, Trajectory, Truncation

__all__ = ["BatchTrajectory", "Event", "PointMotion", "Rollout", "Trajectory", "Truncation"]

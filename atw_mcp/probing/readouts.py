"""Readouts of a rollout for an agent: motion in a few numbers, events in order, trajectories thinned out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.intervals import Span
from atw_mcp.observation.periods import periods
from polyworld.probing.motion_quantities import accelerations, mechanical_quantities
from polyworld.trajectory import Event, Rollout
from polyworld.world import World
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

SAME_BLOW_FRAMES = 2.0  # touches of one pair no further apart are one collision of the timeline
STILL = 0.01  # [m/s]
IMPACT = 0.1  # approach speed from which a touch of the floor is a collision [m/s]
HAPPENS = {
    "entry": "enters the view",
    "exit": "leaves the view",
    "rest": "comes to rest",
    "release": "is let go",
}

COLUMNS = ("time", "frame", "x", "y", "z", "vx", "vy", "vz", "speed", "yaw_deg", "u", "v")
MECHANICAL = ("ax", "ay", "az", "px", "py", "pz", "kinetic_energy", "potential_energy", "energy")


def floors(world: World) -> set[str]:
    """Return the statics that things stand on: planes facing up."""
    return {
        s.name
        for s in world.statics
        if isinstance(s.shape, Plane) and s.shape.normal[2] > 0.5 * _length(s.shape.normal)
    }


def event_row(event: Event, span: Span) -> dict[str, Any]:
    """Return an event as an agent reads it: without what it does not have."""
    row = {"kind": event.kind, "time": event.time, "frame": span.frame(event.time), "objects": list(event.participants)}
    optional = {
        "impulse_Ns": event.impulse,
        "approach_speed": event.speed,
        "position": None if event.position is None else list(event.position),
    }
    return {**row, **{key: value for key, value in optional.items() if value is not None}}


def reported_events(world: World, rollout: Rollout) -> tuple[Event, ...]:
    """Return the events worth reporting: all but contacts of objects that stand on something.

    Left out are contacts with a static that an object touches from its start on, and touches of a floor slower than
    IMPACT that are not the first after flight (nor continue a reported one), with their ends.
    """
    frame = world.time.seconds_per_frame
    statics, ground = {s.name for s in world.statics}, floors(world)
    starts = {o.name: float(getattr(o, "start_time", 0.0)) for o in (*world.objects, *world.deformables)}
    kept: list[Event] = []
    met: set[tuple[str, ...]] = set()
    until: dict[tuple[str, ...], float] = {}
    open_: set[tuple[str, ...]] = set()
    for event in rollout.events:
        pair = event.participants
        if event.kind not in ("contact_begin", "contact_end") or not set(pair) & statics:
            kept.append(event)
            continue
        if event.kind == "contact_begin":
            first, slow = pair not in met, (event.speed or 0.0) < IMPACT
            met.add(pair)
            from_start = first and event.time <= max(starts.get(name, 0.0) for name in pair) + frame
            goes_on = event.time - until.get(pair, -np.inf) <= SAME_BLOW_FRAMES * frame
            if slow and (from_start or (set(pair) & ground and not first and not goes_on)):
                continue
            open_.add(pair)
        elif pair not in open_:
            continue
        else:
            open_.discard(pair)
        until[pair] = event.time
        kept.append(event)
    return tuple(kept)


def floor_contacts_included(world: World, *rollouts: Rollout) -> bool:
    """Check whether `reported_events` leaves no contact out."""
    return all(len(reported_events(world, rollout)) == len(rollout.events) for rollout in rollouts)


def timeline(world: World, rollout: Rollout, span: Span) -> list[dict[str, Any]]:
    """Return collisions, entries, exits, rests and releases of `reported_events` in order of time."""
    return in_order(reported_events(world, rollout), rollout, span)


def in_order(events: Iterable[Event], rollout: Rollout, span: Span) -> list[dict[str, Any]]:
    """Return events as rows in order of time; the touches of one blow are one collision.

    Its impulse is the sum over its touches, None where the last of them still lasts at the end of the rollout.
    """
    rows: list[dict[str, Any]] = []
    open_blows: dict[tuple[str, ...], dict[str, Any]] = {}
    touching: dict[tuple[str, ...], dict[str, Any]] = {}
    gap = SAME_BLOW_FRAMES * span.seconds_per_frame
    for event in events:
        if event.kind == "contact_begin":
            blow = open_blows.get(event.participants)
            if blow is not None and event.time - blow["until"] <= gap:
                blow["touches"] += 1
                blow["until"] = max(blow["until"], event.time)
                touching[event.participants] = blow
                continue
            blow = {
                "what": "collision",
                "objects": list(event.participants),
                "time": event.time,
                "frame": span.frame(event.time),
                "until": event.time,
                "touches": 1,
                "impulse_Ns": 0.0,
                "approach_speed": event.speed,
            }
            open_blows[event.participants] = touching[event.participants] = blow
            rows.append(blow)
        elif event.kind == "contact_end":
            blow = touching.pop(event.participants, None)
            if blow is not None:
                blow["until"] = event.time
                blow["impulse_Ns"] += event.impulse or 0.0
        else:
            what = HAPPENS[event.kind]
            rows.append(
                {"what": what, "objects": list(event.participants), "time": event.time, "frame": span.frame(event.time)}
            )
    for blow in touching.values():  # they still touch where the rollout ends
        blow["until"] = float(rollout.trajectory.times[-1])
        blow["still_touching"], blow["impulse_Ns"] = True, None
    # A collision that began before the span and lasts into it belongs to it.
    return [row for row in rows if row["time"] <= span.end and row.get("until", row["time"]) >= span.start]


def in_words(rows: Iterable[dict[str, Any]], most: int = 6) -> str:
    """Return a timeline in words, for a summary."""
    rows = list(rows)
    texts = [
        f"{_who(row['objects'])} at {row['time']:.3g} s"
        if row["what"] == "collision"
        else f"{row['objects'][0]} {row['what']} at {row['time']:.3g} s"
        for row in rows[:most]
    ]
    more = f"; and {len(rows) - most} more" if len(rows) > most else ""
    return "; ".join(texts) + more if texts else "nothing collides, enters, leaves or comes to rest"


def _who(objects: list[str]) -> str:
    """Who collides, in words."""
    return f"{objects[0]} touches itself" if len(set(objects)) == 1 else f"{' and '.join(objects)} collide"


def motion(rollout: Rollout, name: str, span: Span) -> dict[str, Any]:
    """One object's motion over a span in a few numbers; None where it is not active in it."""
    trajectory = rollout.trajectory
    column = trajectory.index(name)
    rows = _rows(rollout, column, span)
    if not len(rows):
        return {"object": name, "active": False}
    positions = trajectory.positions[rows, column]
    speeds = np.linalg.norm(trajectory.velocities[rows, column], axis=1)
    return {
        "object": name,
        "start": positions[0].tolist(),
        "end": positions[-1].tolist(),
        "displacement": float(np.linalg.norm(positions[-1] - positions[0])),
        "path_length": float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()),
        "highest_speed": float(speeds.max()),
        "final_speed": float(speeds[-1]),
        "moving_at_end": bool(speeds[-1] > STILL),
    }


def periods_of(rollout: Rollout, name: str, span: Span) -> dict[str, Any] | None:
    """Period [s] of each coordinate in which an object goes to and fro over a span; None where there is none."""
    column = rollout.trajectory.index(name)
    rows = _rows(rollout, column, span)
    return periods(rollout.trajectory.times[rows], rollout.trajectory.positions[rows, column]) or None


def series(world: World, rollout: Rollout, name: str, span: Span, columns: Iterable[str]) -> list[list[Any]]:
    """Rows of one object's motion at the samples of a span, with some of `COLUMNS` and `MECHANICAL`.

    yaw_deg is the heading of the body's x axis about the vertical; u, v is the pixel of its centre, None where
    the world has no camera or the centre is behind it. Raises ValueError for momentum or energy of a deformable object.
    """
    trajectory = rollout.trajectory
    column = trajectory.index(name)
    rows = _rows(rollout, column, span)
    times = trajectory.times[rows]
    p, v = trajectory.positions[rows, column], trajectory.velocities[rows, column]
    axis = quaternion_matrix(trajectory.orientations[rows, column])[..., 0]
    pixels = world.camera.project(p) if world.camera is not None else np.full((len(rows), 2), np.nan)
    table: dict[str, Array] = {
        "time": times,
        "frame": np.round(times / span.seconds_per_frame, 2),
        **{key: p[:, i] for i, key in enumerate("xyz")},
        **{f"v{key}": v[:, i] for i, key in enumerate("xyz")},
        "speed": np.linalg.norm(v, axis=1),
        "yaw_deg": np.degrees(np.arctan2(axis[:, 1], axis[:, 0])),
        "u": pixels[:, 0],
        "v": pixels[:, 1],
    }
    columns = list(columns)
    if set(columns) & {"ax", "ay", "az"}:
        table |= {f"a{axis}": a for axis, a in zip("xyz", accelerations(trajectory, name)[rows].T, strict=True)}
    if set(columns) & set(MECHANICAL[3:]):
        found = mechanical_quantities(world, trajectory, name)
        table |= {f"p{axis}": p for axis, p in zip("xyz", found.momentum[rows].T, strict=True)}
        table |= {"kinetic_energy": found.kinetic_energy[rows], "potential_energy": found.potential_energy[rows]}
        table["energy"] = table["kinetic_energy"] + table["potential_energy"]
    values = np.stack([table[key] for key in columns], axis=1)
    return [[value if np.isfinite(value) else None for value in row] for row in values.tolist()]


def thinned(rows: list[Any], limit: int) -> list[Any]:
    """At most `limit` of the rows: every k-th from the first on, and the last."""
    if len(rows) <= limit:
        return rows
    kept = rows[:: -(-(len(rows) - 1) // (max(limit, 2) - 1))]
    return kept if kept[-1] is rows[-1] else [*kept, rows[-1]]


def _rows(rollout: Rollout, column: int, span: Span) -> NDArray[np.intp]:
    trajectory = rollout.trajectory
    slack = 1e-6 * span.seconds_per_frame
    inside = (trajectory.times >= span.start - slack) & (trajectory.times <= span.end + slack)
    return np.flatnonzero(inside & trajectory.active[:, column])


def _length(vector: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(vector))

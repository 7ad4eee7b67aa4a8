"""Resources: cases, worlds, rollouts, results, pictures and schemas by address, whole and at full precision."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING, Any

from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ResourceNotFoundError

from atw_mcp.calls.app import App
from atw_mcp.calls.resource_errors import explaining
from atw_mcp.calls.results import plain
from atw_mcp.calls.schemas import inlined
from evidence_store import Evidence

if TYPE_CHECKING:
    from evidence_store import Case
    from polyworld.trajectory import Rollout
    from polyworld.world import World

JSON = "application/json"
SCHEMA = "application/schema+json"
CSV_COLUMNS = ("time", "frame", "x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")


def register(server: MCPServer[Any], app: App) -> None:
    """Serve every resource of a store."""
    _register_records(server, app)
    _register_rollouts(server, app)
    _register_pictures(server, app)
    _register_schemas(server, app)


def image_type(content: bytes) -> str:
    """Return the media type of an encoded picture."""
    return "image/png" if content.startswith(b"\x89PNG") else "image/jpeg"


def _register_records(server: MCPServer[Any], app: App) -> None:
    @server.resource("atw://cases", title="Cases", description="every case of the store", mime_type=JSON)
    def cases() -> str:
        with explaining():
            rows = [_case_line(app, case) for case in app.store.cases.all()]
            return _json({"cases": rows, "damaged": app.store.cases.damaged()})

    @server.resource(
        "atw://cases/{case}",
        title="A case",
        description="facts, questions, observations, worlds, bindings, answers and one line for each result",
        mime_type=JSON,
    )
    def one_case(case: str) -> str:
        with explaining():
            found = app.store.cases.get(case)
            store = app.store.cases
            return _json(
                {
                    **_case_line(app, found),
                    "facts": found.facts,
                    "questions": store.questions(found.id),
                    "observations": [{"kind": k, "observation": o} for k, o in store.observations(found.id)],
                    "worlds": [{"world": w, "origin": o} for w, o in store.worlds(found.id)],
                    "bindings": [vars(binding) for binding in store.bindings(found.id).values()],
                    "answers": [vars(answer) for answer in store.answers(found.id)],
                    "evidence": [
                        {"evidence": r.id, "tool": r.tool, "status": r.status, "summary": r.summary}
                        for r in app.store.evidence.of_case(found.id)
                    ],
                }
            )

    @server.resource("atw://worlds/{world}", title="A world", description="its whole description", mime_type=JSON)
    def world_document(world: str) -> str:
        with explaining():
            return app.store.worlds.document(world)

    @server.resource(
        "atw://evidence/{evidence}",
        title="A whole result",
        description="everything a tool returned, at full length and precision",
        mime_type=JSON,
    )
    def one_result(evidence: str) -> str:
        record = _record(app, evidence)
        body = {
            "evidence": record.id,
            "tool": record.tool,
            "arguments": record.arguments,
            "status": record.status,
            "summary": record.summary,
            "case": record.case,
            "source": {"world": record.world, "rollout": record.rollout, "observation": record.observation},
            "objects": list(record.objects),
            "interval": record.interval,
            "data": record.payload.get("data", {}),
            "pictures": sorted(record.pictures),
        }
        return _json(body)


def _register_rollouts(server: MCPServer[Any], app: App) -> None:
    def read(rollout: str) -> tuple[Case, World, Rollout]:
        from atw_mcp.worlds.rollouts import stored_rollout  # the engine

        with explaining():
            return stored_rollout(app, rollout)

    @server.resource(
        "atw://rollouts/{rollout}", title="A rollout", description="what was run, and how it ended", mime_type=JSON
    )
    def one_rollout(rollout: str) -> str:
        case, world, result = read(rollout)
        return _json(
            {
                "rollout": rollout,
                "case": case.id,
                "world": world.id,
                "status": result.status,
                "horizon_s": result.horizon,
                "samples": len(result.trajectory.times),
                "objects": list(result.trajectory.names),
                "events": len(result.events),
            }
        )

    @server.resource(
        "atw://rollouts/{rollout}/trajectory.csv",
        title="Trajectories",
        description="one row a sample and object: " + ", ".join(("object", *CSV_COLUMNS)) + "; SI units",
        mime_type="text/csv",
    )
    def trajectories(rollout: str) -> str:
        _, world, result = read(rollout)
        return _table(world, result, result.trajectory.names)

    @server.resource(
        "atw://rollouts/{rollout}/{object}.csv",
        title="Trajectory of one object",
        description="one row a sample: " + ", ".join(("object", *CSV_COLUMNS)) + "; SI units",
        mime_type="text/csv",
    )
    def trajectory(rollout: str, object: str) -> str:
        _, world, result = read(rollout)
        if object not in result.trajectory.names:
            raise ResourceNotFoundError(f"{rollout} has no object {object!r}; objects: {list(result.trajectory.names)}")
        return _table(world, result, (object,))

    @server.resource(
        "atw://rollouts/{rollout}/events",
        title="Events of a rollout",
        description="every contact, entry, exit, rest and release, touches of the floor included",
        mime_type=JSON,
    )
    def events(rollout: str) -> str:
        from atw_mcp.calls.intervals import Span
        from atw_mcp.probing.readouts import event_row

        _, world, result = read(rollout)
        span = Span(0.0, result.horizon, world.time.seconds_per_frame)
        return _json({"rollout": rollout, "events": [event_row(event, span) for event in result.events]})


def _register_pictures(server: MCPServer[Any], app: App) -> None:
    @server.resource(
        "atw://evidence/{evidence}/pictures/{name}",
        title="A picture of a result",
        description="PNG or JPEG, as the tool returned it",
        mime_type="image/jpeg",
    )
    def picture(evidence: str, name: str) -> bytes:
        record = _record(app, evidence)
        if name not in record.pictures:
            raise ResourceNotFoundError(f"{evidence} has no picture {name!r}; pictures: {sorted(record.pictures)}")
        return record.pictures[name]

    @server.resource(
        "atw://frames/{case}/{frame}",
        title="A frame of a case's video",
        description="the frame of this number, from 0, as a JPEG",
        mime_type="image/jpeg",
    )
    def frame_picture(case: str, frame: str) -> bytes:
        with explaining():
            found = app.store.cases.get(case)
        if found.kind != "video":
            raise ResourceNotFoundError(f"case {case!r} has no video")
        if not frame.isdecimal():
            raise ResourceNotFoundError(f"a frame is a number from 0, got {frame!r}")
        from atw_mcp.looking.overlay import encoded  # OpenCV
        from atw_mcp.perception.video import read_frames

        with explaining():
            image = read_frames(app.files.film(found.path), [int(frame)])[0]
        return next(iter(encoded({f"frame {frame}": image})[0].values()))


def _register_schemas(server: MCPServer[Any], app: App) -> None:
    @server.resource(
        "atw://schema/world",
        title="Schema of a world",
        description="JSON schema of the world that BuildWorld takes as a whole",
        mime_type=SCHEMA,
    )
    def world_schema() -> str:
        from polyworld.world import World  # the engine

        return json.dumps(inlined(World.model_json_schema()))

    @server.resource(
        "atw://schema/tools/{tool}",
        title="A tool in full",
        description="description and whole input and output schema, of which the list has a short form",
        mime_type=JSON,
    )
    def tool_schema(tool: str) -> str:
        found = next((known for known in app.served if known.name == tool), None)
        if found is None:
            raise ResourceNotFoundError(f"no tool {tool!r}; tools: {', '.join(t.name for t in app.served)}")
        return _json(
            {
                "name": found.name,
                "title": found.title,
                "description": found.description,
                "inputSchema": found.parameters,
                "outputSchema": found.full_output,
            }
        )


def _case_line(app: App, case: Case) -> dict[str, Any]:
    path = app.files.shown(case.path)
    return {"case": case.id, "kind": case.kind, "path": path, "committed_world": case.committed_world}


def _record(app: App, identifier: str) -> Evidence:
    with explaining():
        return app.store.read_evidence(identifier)


def _table(world: World, result: Rollout, names: tuple[str, ...]) -> str:
    """The motion of objects as CSV, one row a sample in which they take part."""
    run = result.trajectory
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("object", *CSV_COLUMNS))
    for name in names:
        column = run.index(name)
        for number, time in enumerate(run.times):
            if run.active[number, column]:
                state = (run.positions, run.orientations, run.velocities, run.angular_velocities)
                values = [float(value) for array in state for value in array[number, column]]
                rows.writerow((name, float(time), float(time / world.time.seconds_per_frame), *values))
    return text.getvalue()


def _json(value: Any) -> str:
    return json.dumps(plain(value), ensure_ascii=False, allow_nan=False, separators=(",", ":"))

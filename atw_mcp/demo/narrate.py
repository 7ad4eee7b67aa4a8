"""`atw-mcp demo`: run a demo script over MCP, say what happens, and check every result against the ground truth."""

from __future__ import annotations

import os
import shlex
import sys
import textwrap
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np

from atw_mcp.client import Session
from atw_mcp.demo.truth import FOLDER, Collision, TrueRun, hidden_pull, rms_distance, true_runs
from atw_mcp.looking.overlay import contact_sheet
from atw_mcp.replies import Reply
from atw_mcp.script import Step, read_script, run_script

WIDTH = 100  # characters of a line


class Narrator:
    """Prints what is about to be done, and what came of it."""

    def __init__(self, out: TextIO) -> None:
        self.out = out
        self._number = 0
        self._began = 0.0

    def begin(self, _: Step, said: str | None) -> None:
        """Say what a step is for."""
        if said:
            self._number += 1
            self.say("")
            self.say(f"{self._number}. {' '.join(said.split())}", indent="   ")
        self._began = time.perf_counter()

    def end(self, step: Step, reply: Reply) -> None:
        """Say what a step found."""
        took = time.perf_counter() - self._began
        found = textwrap.shorten(reply.body["summary"], 300, placeholder=" ...")
        self.say(f"   {step.tool}: {found} [{reply.body['evidence']}, {took:.1f} s]", indent="     ")

    def say(self, text: str, indent: str = "") -> None:
        """Print a paragraph."""
        print("\n".join(textwrap.wrap(text, WIDTH, subsequent_indent=indent)), file=self.out, flush=True)


@dataclass(frozen=True)
class Demo:
    """A demo: its script, what it shows in a sentence, how it is checked against the truth, and the results whose
    pictures are kept, with what they show."""

    script: str
    about: str
    check: Callable[[Session, dict[str, Reply], Narrator], Awaitable[None]]
    pictures: tuple[tuple[str, str], ...]


async def demo(session: Session, which: str, folder: Path, store: Path, out: TextIO) -> None:
    """Run one of `DEMOS` on the session's store; pictures are written to `folder`."""
    began = time.perf_counter()
    chosen = DEMOS[which]
    narrator = Narrator(out)
    narrator.say(
        f"Asking the World: {chosen.about}. Each call below goes to the MCP server as an LLM agent's would; ev-... is "
        "the evidence that it leaves."
    )
    results: dict[str, Reply] = {}
    steps = read_script(FOLDER / chosen.script)
    variables = {"folder": str(FOLDER), "name": await _new_name(session)}
    async for step, reply in run_script(steps, session, variables, narrator.begin):
        narrator.end(step, reply)
        results[step.name or step.tool] = reply
    await chosen.check(session, results, narrator)
    narrator.say("")
    for name, what in chosen.pictures:
        narrator.say(f"Picture of {what}: {_write_pictures(results[name], folder, name)}")
    narrator.say(f"Done in {time.perf_counter() - began:.1f} s. To see all of it in a browser:")
    print(
        f"   {_program()} view {results['open'].body['case']} --store {shlex.quote(str(store))}", file=out, flush=True
    )


def _program() -> str:
    """Return how this program was called, to call it again: by uv, in a project or from its cache, or directly."""
    if "UV" not in os.environ:
        return "atw-mcp"
    return "uvx atw-mcp" if "archive-v" in sys.prefix else "uv run atw-mcp"


async def _new_name(session: Session) -> str:
    """A name that no case of the store has: a committed case cannot be modelled again."""
    taken = {case["case"] for case in (await session.call("OpenCase", {})).body["data"]["cases"]}
    return next(name for number in range(1, len(taken) + 2) if (name := f"demo-{number}") not in taken)


async def _check_collision(session: Session, results: dict[str, Reply], narrator: Narrator) -> None:
    filmed, what_if = true_runs()
    narrator.say("")
    narrator.say("Checked against the simulator that made the clip, which none of the above has seen:")
    case = results["open"].body["case"]
    tracked = {name: await _tracked_error(session, case, name, filmed) for name in filmed.positions}
    fitted = await _rollout_errors(session, results["filmed"], filmed)
    predicted = await _rollout_errors(session, results["without"], what_if)
    header = f"   {'distance to the truth [mm rms]':32}{'seen in video':>15}{'fitted world':>15}{'blue removed':>15}"
    print(header, file=narrator.out)
    for name in filmed.positions:
        cells = [tracked[name], fitted[name], predicted.get(name)]
        row = "".join(f"{'-' if cell is None else f'{1000 * cell:.1f}':>15}" for cell in cells)
        print(f"   {name:32}{row}", file=narrator.out)
    moved = rms_distance(
        list(range(len(what_if.positions["red_cylinder"]))),
        what_if.positions["red_cylinder"].tolist(),
        filmed.positions["red_cylinder"],
    )
    narrator.say(f"   (Taking the removal for no change at all would put red_cylinder {1000 * moved:.0f} mm off.)")
    for label, reply, truth in (
        ("Collisions as filmed", results["filmed"], filmed),
        ("Collisions without the blue cube", results["without"], what_if),
    ):
        found = [
            Collision(frozenset(row["objects"]), row["time"])
            for row in reply.body["data"]["timeline"]
            if row["what"] == "collision"
        ]
        narrator.say(f"   {label}")
        narrator.say(f"      found:    {_in_words(found)}", indent=" " * 16)
        narrator.say(f"      in truth: {_in_words(truth.collisions)}", indent=" " * 16)
    narrator.say("   Answers")
    touch = frozenset({"red_cylinder", "yellow_cylinder"})
    for name, truth in (("answer_filmed", filmed), ("answer_what_if", what_if)):
        data = results[name].body["data"]
        true_answer = "true" if any(c.pair == touch for c in truth.collisions) else "false"
        verdict = "right" if data["answer"] == true_answer else "WRONG"
        ids = ", ".join(item["evidence"] for item in data["evidence"])
        narrator.say(f"      {data['question']} {data['answer']} - {verdict} ({ids})", indent=" " * 8)


async def _tracked_error(session: Session, case: str, name: str, truth: TrueRun) -> float:
    reply = await session.call("InspectObservedMotion", {"case": case, "object": name, "limit": 500})
    data = reply.body["data"]
    frame, x = data["columns"].index("frame"), data["columns"].index("x")
    rows = [row for row in data["rows"] if row[x] is not None]
    return rms_distance([row[frame] for row in rows], [row[x : x + 3] for row in rows], truth.positions[name])


async def _rollout_errors(session: Session, rollout: Reply, truth: TrueRun) -> dict[str, float]:
    errors = {}
    for name, positions in truth.positions.items():
        arguments = {
            "rollout": rollout.body["data"]["rollout"],
            "object": name,
            "limit": 500,
            "fields": ["frame", "x", "y", "z"],
        }
        data = (await session.call("ReadTrajectory", arguments)).body["data"]
        rows = [row for row in data["rows"] if float(row[0]).is_integer()]
        errors[name] = rms_distance([int(row[0]) for row in rows], [row[1:] for row in rows], positions)
    return errors


async def _check_gap(session: Session, results: dict[str, Reply], narrator: Narrator) -> None:
    hidden, unfilmed = hidden_pull()
    found = results["what"].body["data"]
    effect: dict[str, Any] = (
        found["proposals"][0]["effects"][0] if found["proposals"] else {"name": "nothing", "unknowns": {}}
    )
    right = found["verdict"] == "identified" and effect["name"] == hidden.effect
    narrator.say("")
    narrator.say("Checked against the simulator that made the clip, which none of the above has seen:")
    narrator.say(
        f"   Verdict: {found['verdict']}, {effect['name']}; in truth {hidden.effect} - {'right' if right else 'WRONG'} "
        f"({results['what'].body['evidence']})",
        indent=" " * 6,
    )
    for axis, true in zip("xy", hidden.acceleration, strict=True):
        known = effect["unknowns"].get(axis)
        if known is not None:
            low, high = known["interval95"]
            narrator.say(
                f"      pull along {axis}: {known['value']:.4f} m/s^2, 95% {low:.4f} to {high:.4f}; in truth {true:.4f}"
            )
    sealed = results["add"].body["data"]["sealed"]
    narrator.say(
        f"   Sealed third of the video: gap {1000 * sealed['gap_before']:.2f} mm without it, "
        f"{1000 * sealed['gap_after']:.2f} mm with it; noise {1000 * sealed['noise_floor']:.2f} mm",
        indent=" " * 6,
    )
    narrator.say("   A run that was never filmed, predicted:")
    print(f"   {'distance to the truth [mm rms]':32}{'without it':>15}{'with it':>15}", file=narrator.out)
    pairs = [await _rollout_errors(session, results[name], unfilmed) for name in ("without", "elsewhere")]
    for name in unfilmed.positions:
        cells = "".join(f"{1000 * errors[name]:>15.1f}" for errors in pairs)
        print(f"   {name:32}{cells}", file=narrator.out)


def _in_words(collisions: list[Collision] | tuple[Collision, ...]) -> str:
    return "; ".join(c.in_words() for c in collisions) or "none"


def _write_pictures(reply: Reply, folder: Path, name: str) -> str:
    """Write the pictures of a reply as PNG files, those of the first one's size on one sheet; returns their paths."""
    read = [cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR) for _, content in reply.pictures]
    images = [np.asarray(image, dtype=np.uint8) for image in read if image is not None]
    equal = [image for image in images if image.shape == images[0].shape]
    others = [image for image in images if image.shape != images[0].shape]
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, sheet in enumerate([contact_sheet(equal, columns=2), *others], 1):
        path = folder / (f"{name}.png" if number == 1 else f"{name}-{number}.png")
        done, file = cv2.imencode(".png", sheet)
        if not done:
            raise ValueError(f"the pictures could not be encoded for {path}")
        path.write_bytes(file.tobytes())
        paths.append(str(path.absolute()))
    return ", ".join(paths)


DEMOS = {
    "collision": Demo(
        "collision.atw",
        "a video in, an answered what-if question out",
        _check_collision,
        (("overlay", "the world over the video"), ("what_if", "without the blue cube")),
    ),
    "gap": Demo(
        "gap.atw",
        "a video that its world does not explain in, the missing effect and a better world out",
        _check_gap,
        (
            ("where", "where the fitted world is wrong"),
            ("add", "the sealed part of the video, with and without the effect"),
            ("overlay", "the better world over the video"),
        ),
    ),
}

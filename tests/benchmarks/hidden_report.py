"""The table of the benchmark: counts, bars, 95% Wilson intervals, and every failure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Outcome = dict[str, Any]

SHARE = {0.001: "0.1%", 0.01: "1%", 0.03: "3%"}
RIGHT_BARS = {0.001: 0.99, 0.01: 0.98, 0.03: 0.92}
CLOSED_BARS = {0.001: 0.98, 0.01: 0.85, 0.03: 0.55}
UNEXPLAINED_BARS = {0.001: 0.95, 0.01: 0.70}
SECONDS_BAR = 10.0


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95% interval of a share (Wilson 1927, J. Am. Stat. Assoc. 22, 209)."""
    if count == 0:
        return 0.0, 1.0
    z2 = 1.959963984540054**2
    middle = (hits + z2 / 2.0) / (count + z2)
    half = np.sqrt(z2 * (hits * (count - hits) / count + z2 / 4.0)) / (count + z2)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


@dataclass(frozen=True)
class Row:
    """A line of the table. bar: ">= 0.99" and the like in words; value and met are None where nothing was run."""

    name: str
    result: str
    bar: str
    met: bool | None

    def line(self) -> str:
        """As printed."""
        mark = {True: "met", False: "MISSED", None: "-"}[self.met]
        return f"{self.name:<46} {self.result:<38} {self.bar:<16} {mark}"

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {"name": self.name, "result": self.result, "bar": self.bar, "met": self.met}


def share_row(name: str, flags: Sequence[bool], *, least: float | None = None, most: float | None = None) -> Row:
    """Return a share against a bar from below or above."""
    hits, count = sum(flags), len(flags)
    bar = f">= {least:.0%}" if least is not None else f"<= {most:.0%}" if most is not None else ""
    if least is not None and most is not None:
        bar = f"{least:.0%} to {most:.0%}"
    if count == 0:
        return Row(name, "no case", bar, None)
    value, (low, high) = hits / count, wilson(hits, count)
    met = (least is None or value >= least - 1e-12) and (most is None or value <= most + 1e-12)
    result = f"{hits}/{count} = {value:.1%} ({low:.1%} to {high:.1%})"
    return Row(name, result, bar, met if bar else None)


def value_row(name: str, values: Sequence[float], bar: float, *, at_most: bool, form: str = "{:.1%}") -> Row:
    """Return a median (or, `at_most`, the largest but one in ten) against a bar."""
    words = ("<= " if at_most else ">= ") + form.format(bar)
    if not len(values):
        return Row(name, "no case", words, None)
    value = float(np.quantile(values, 0.9)) if at_most else float(np.median(values))
    result = f"{form.format(value)} of {len(values)}"
    return Row(name, result, words, value <= bar if at_most else value >= bar)


def table(outcomes: Sequence[Outcome]) -> list[Row]:
    """Return all rows."""
    by = {s: [o for o in outcomes if o["section"] == s] for s in dict.fromkeys(o["section"] for o in outcomes)}
    rows: list[Row] = []
    for section, rows_of in _SECTIONS.items():
        if section in by:
            rows += rows_of(by[section])
    crashed = [o["verdict"] == "crashed" for o in outcomes]
    rows.append(share_row("crashes", crashed, most=0.0))
    if "one_effect" in by or "nothing" in by:
        single = [o for s in ("one_effect", "nothing") for o in by.get(s, []) if o["seconds"] is not None]
        for key, name in (("seconds", "by the clock"), ("cpu_seconds", "of work")):
            title = f"seconds a verdict {name}, one body, 9 in 10"
            rows.append(value_row(title, [o[key] for o in single], SECONDS_BAR, at_most=True, form="{:.1f}"))
    return rows


def _at(outcomes: Iterable[Outcome], noise: float) -> list[Outcome]:
    return [o for o in outcomes if o["noise"] == noise]


def _one_effect(outcomes: list[Outcome]) -> list[Row]:
    rows = [
        share_row(f"one effect, right name, {SHARE[n]} noise", [o["right"] for o in _at(outcomes, n)], least=bar)
        for n, bar in RIGHT_BARS.items()
    ]
    rows.append(share_row("one effect, decisive wrong name", [o["decisive_wrong"] for o in outcomes], most=0.01))
    rows.append(share_row("one effect, credible set covers", [o["covers"] for o in outcomes], least=0.99))
    sizes = [o["size"] for o in outcomes if o["size"]]
    mean = float(np.mean(sizes)) if sizes else 0.0
    result, met = (f"{mean:.2f} of {len(sizes)}", mean <= 1.2) if sizes else ("no case", None)
    rows.append(Row("one effect, mean size of the credible set", result, "<= 1.2", met))
    rows += _held_out_gap(outcomes)
    held = [h for o in outcomes for h in o["inside"].values()]
    rows.append(share_row("95% intervals hold the truth", held, least=0.90, most=0.98))
    placed = [o["place"] for o in outcomes if o["place"] is not None]
    rows.append(share_row("place or onset overlaps the truth", placed, least=0.90))
    return rows


def _held_out_gap(outcomes: list[Outcome]) -> list[Row]:
    rows = []
    for noise, bar in CLOSED_BARS.items():
        shown = [o for o in _at(outcomes, noise) if o["closed"] is not None]
        rows.append(
            value_row(f"sealed gap closed, median, {SHARE[noise]}", [o["closed"] for o in shown], bar, at_most=False)
        )
        with_noise = [o["closed_with_noise"] for o in shown]
        if with_noise:
            median = float(np.median(with_noise))
            rows.append(Row("  the same with the noise in both gaps", f"{median:.1%} of {len(shown)}", "", None))
    return rows


def _nothing(outcomes: list[Outcome]) -> list[Row]:
    bars = {"white": 0.01, "ar1": 0.05, "outliers": 0.05, "missing_rows": 0.05}
    return [
        share_row(
            f"nothing hidden, {kind}: false alarms",
            [o["verdict"] != "nothing_missing" for o in outcomes if o["kind"] == kind],
            most=bar,
        )
        for kind, bar in bars.items()
    ]


def _two_effects(outcomes: list[Outcome]) -> list[Row]:
    return [
        share_row("two effects, exact", [o["right"] for o in outcomes], least=0.90),
        share_row("two effects, wrong although it passes", [o["decisive_wrong"] for o in outcomes], most=0.02),
    ]


def _outside(outcomes: list[Outcome]) -> list[Row]:
    rows = []
    for noise, bar in UNEXPLAINED_BARS.items():
        here = _at(outcomes, noise)
        # A force that contains effects of the catalogue may be named by them.
        good = [o["verdict"] == "unexplained" or o["right"] for o in here]
        rows.append(share_row(f"outside the catalogue, unexplained, {SHARE[noise]}", good, least=bar))
    described = [o["form"] for o in outcomes if o["verdict"] == "unexplained" or o["right"]]
    rows.append(share_row("outside the catalogue, its form right", described, least=0.80))
    rows.append(share_row("outside the catalogue, one name given", [o["decisive_wrong"] for o in outcomes]))
    return rows


def _poor(outcomes: list[Outcome]) -> list[Row]:
    rows = [share_row("poor designs, decisive wrong name", [o["decisive_wrong"] for o in outcomes], most=0.01)]
    for design in sorted({o["design"] for o in outcomes}):
        here = [o for o in outcomes if o["design"] == design]
        rows.append(share_row(f"  {design}: right", [o["right"] for o in here]))
    asked = [o for o in outcomes if o["proposed"]]
    rows.append(share_row("poor designs, ambiguous that propose", [o["proposed"] for o in outcomes if o["size"] > 1]))
    rows.append(
        share_row(
            "proposed experiment, run, resolves",
            [bool(o["resolved"]) for o in asked if o["resolved"] is not None],
            least=0.90,
        )
    )
    return rows


def _bodies(outcomes: list[Outcome], scene: str = "bodies") -> list[Row]:
    hidden = [o for o in outcomes if o["truth"]]
    rows = [
        share_row(f"{scene}, right name, {SHARE[n]} noise", [o["right"] for o in _at(hidden, n)], least=bar)
        for n, bar in RIGHT_BARS.items()
    ]
    rows.append(share_row(f"{scene}, decisive wrong name", [o["decisive_wrong"] for o in hidden], most=0.01))
    rows.append(share_row(f"{scene}, credible set covers", [o["covers"] for o in hidden], least=0.99))
    alarms = [o["verdict"] != "nothing_missing" for o in outcomes if not o["truth"]]
    rows.append(share_row(f"{scene}, nothing hidden: false alarms", alarms, most=0.01))
    rows += _held_out_gap(hidden)
    held = [h for o in hidden for h in o["inside"].values()]
    rows.append(share_row(f"{scene}, 95% intervals hold the truth", held, least=0.90, most=0.98))
    seconds = [o["cpu_seconds"] for o in outcomes if o["cpu_seconds"] is not None]
    rows.append(value_row(f"{scene}, seconds of work, 9 in 10", seconds, 60.0, at_most=True, form="{:.1f}"))
    return rows


def _unturned(outcomes: list[Outcome]) -> list[Row]:
    return _bodies(outcomes, "bodies, turns unobserved")


_SECTIONS: dict[str, Callable[[list[Outcome]], list[Row]]] = {
    "one_effect": _one_effect,
    "nothing": _nothing,
    "two_effects": _two_effects,
    "outside": _outside,
    "poor_designs": _poor,
    "bodies": _bodies,
    "unturned_bodies": _unturned,
}


def failed(o: Outcome) -> bool:
    """Return whether a case's verdict is not what it should be."""
    if o["verdict"] == "crashed":
        return True
    if not o["truth"]:
        return bool(o["verdict"] != "nothing_missing")
    if o["section"] == "outside":
        return not o["form"]
    if o["section"] == "poor_designs":
        return bool(o["decisive_wrong"] or o["resolved"] is False or (o["size"] > 1 and not o["covers"]))
    return not o["right"]


def failure_line(o: Outcome) -> str:
    """Return one line a failure: case, truth, verdict."""
    truth = ", ".join(f"{n} ({s:.1%})" for n, s in zip(o["truth"], o["sizes"], strict=True)) or "nothing"
    found = " | ".join(" + ".join(s) for s in o["credible"]) or " + ".join(o["named"]) or "-"
    tail = ""
    if o["resolved"] is False:
        second = " | ".join(" + ".join(s) for s in o["second_credible"] or []) or "-"
        tail = f"; after the experiment {o['second_verdict']}: {second}"
    if o["section"] == "outside":
        tail = f"; described as {o['expression']}"
    if o["error"]:
        tail = "; " + o["error"].strip().splitlines()[-1]
    noise = f"{o['noise']:.1%} {o['kind']}"
    return f"{o['case']:<18} {noise:<17} {o['design']:<24} truth: {truth}; verdict {o['verdict']}: {found}{tail}"


def written(outcomes: Sequence[Outcome]) -> str:
    """Failures, by effect, and the table."""
    lines = [failure_line(o) for o in outcomes if failed(o)]
    heading = f"failures ({len(lines)} of {len(outcomes)} cases)"
    by_effect: dict[str, list[bool]] = {}
    for o in outcomes:
        if o["section"] == "one_effect":
            by_effect.setdefault(o["truth"][0], []).append(o["right"])
    effects = [f"  {name:<20} {sum(v)}/{len(v)}" for name, v in by_effect.items() if not all(v)]
    parts = [heading, *lines, ""]
    if effects:
        parts += ["effects that were not always named", *effects, ""]
    return "\n".join([*parts, *(row.line() for row in table(outcomes))])

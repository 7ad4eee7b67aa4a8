"""Scores of answered questions as the papers score: the share of options and of whole questions that are right.

A question is right when all its options are judged rightly; one without options (descriptive, or an open question of
ContPhy) counts as one option. An option that was not answered is wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

Z95 = 1.959964  # two-sided 95% of a normal distribution


@dataclass(frozen=True)
class Judged:
    """One option: what was said (None: nothing) and what is right; `line`: what straight lines say."""

    said: Any
    right: Any
    line: Any = None
    note: str = ""

    @property
    def correct(self) -> bool:
        """Whether what was said is right."""
        return self.said is not None and self.said == self.right


@dataclass(frozen=True)
class Question:
    """One question with its options. cause: why it is answered wrongly, "" where it is right."""

    scene: str
    group: str
    kind: str
    text: str
    options: tuple[Judged, ...]
    cause: str = ""
    family: str = ""

    @property
    def correct(self) -> bool:
        """Whether every option is judged rightly."""
        return all(o.correct for o in self.options)


@dataclass
class SceneRun:
    """Outcome of one scene; failed: why nothing could be asked, in the tools' words."""

    scene: str
    group: str
    source: str
    seconds: float = 0.0
    calls: int = 0
    failed: str | None = None
    figures: dict[str, float] = field(default_factory=dict)
    questions: list[Question] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> SceneRun:
        """Read what `to_dict` gave."""
        asked = [Question(**{**q, "options": tuple(Judged(**o) for o in q["options"])}) for q in data.pop("questions")]
        return cls(**data, questions=asked)


def wilson(right: int, count: int) -> tuple[float, float]:
    """Return the 95% score interval of a share (Wilson 1927); (0, 1) of nothing."""
    if count == 0:
        return 0.0, 1.0
    share, z2 = right / count, Z95**2 / count
    middle = (share + z2 / 2) / (1 + z2)
    half = Z95 * ((share * (1 - share) + z2 / 4) / count) ** 0.5 / (1 + z2)
    return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True)
class Row:
    """One line of the table: counts of right options and questions, and those of the two floors."""

    group: str
    kind: str
    options: int
    questions: int
    right_options: int
    right_questions: int
    majority_options: int
    majority_questions: int
    line_options: int | None
    line_questions: int | None
    unanswered: int

    def to_dict(self) -> dict[str, Any]:
        """Return counts, shares and intervals."""
        return {
            **asdict(self),
            "per_option": _share(self.right_options, self.options),
            "per_option_95": wilson(self.right_options, self.options),
            "per_question": _share(self.right_questions, self.questions),
            "per_question_95": wilson(self.right_questions, self.questions),
        }


def rows(questions: Sequence[Question]) -> list[Row]:
    """Return a row for each kind of a group, and for each group as a whole."""
    found = []
    for group in dict.fromkeys(q.group for q in questions):
        own = [q for q in questions if q.group == group]
        kinds = list(dict.fromkeys(q.kind for q in own))
        parts = [_row(group, kind, [q for q in own if q.kind == kind]) for kind in kinds]
        found += parts
        if len(parts) > 1:
            lines = all(p.line_options is not None for p in parts)
            names = [n for n in Row.__dataclass_fields__ if n not in ("group", "kind")]
            sums = {n: sum(getattr(p, n) or 0 for p in parts) for n in names}
            if not lines:
                sums |= {"line_options": None, "line_questions": None}
            found.append(Row(group, "all", **sums))
    return found


def _row(group: str, kind: str, asked: Sequence[Question]) -> Row:
    options = [(q, o) for q in asked for o in q.options]
    usual = {
        family: Counter(o.right for q, o in options if q.family == family).most_common(1)[0][0]
        for family in {q.family for q in asked}
    }
    has_line = any(o.line is not None for _, o in options)
    return Row(
        group,
        kind,
        len(options),
        len(asked),
        sum(o.correct for _, o in options),
        sum(q.correct for q in asked),
        sum(o.right == usual[q.family] for q, o in options),
        sum(all(o.right == usual[q.family] for o in q.options) for q in asked),
        sum(o.line == o.right for _, o in options) if has_line else None,
        sum(all(o.line == o.right for o in q.options) for q in asked) if has_line else None,
        sum(o.said is None for _, o in options),
    )


def causes(questions: Iterable[Question]) -> dict[str, Counter[str]]:
    """Count wrong questions by cause, for each kind."""
    found: dict[str, Counter[str]] = {}
    for q in questions:
        if not q.correct:
            found.setdefault(f"{q.group} {q.kind}", Counter())[q.cause or "unknown"] += 1
    return found


def print_rows(table: Sequence[Row], out: Callable[[str], None]) -> None:
    """Print shares in percent with their 95% intervals, and the floors' per option and per question."""
    out(
        f"{'group':>8} {'type':>15} {'per option':>20} {'n':>5} {'per question':>20} {'n':>5} "
        f"{'majority o/q':>13} {'lines o/q':>13} {'unanswered':>10}"
    )
    for r in table:
        line = "-" if r.line_options is None else _both(r.line_options, r.options, r.line_questions or 0, r.questions)
        out(
            f"{r.group:>8} {r.kind:>15} {_interval(r.right_options, r.options):>20} {r.options:>5} "
            f"{_interval(r.right_questions, r.questions):>20} {r.questions:>5} "
            f"{_both(r.majority_options, r.options, r.majority_questions, r.questions):>13} {line:>13} "
            f"{r.unanswered:>10}"
        )


def _share(right: int, count: int) -> float | None:
    return right / count if count else None


def _interval(right: int, count: int) -> str:
    low, high = wilson(right, count)
    return f"{100 * right / max(count, 1):.1f} ({100 * low:.0f}-{100 * high:.0f})"


def _both(options: int, of: int, questions: int, among: int) -> str:
    return f"{100 * options / max(of, 1):.0f}/{100 * questions / max(among, 1):.0f}"

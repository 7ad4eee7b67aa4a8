"""Work of a case that is not finished, as its workers report it to the store."""

from __future__ import annotations

import re

from atw_mcp.viewer.document import Running
from atw_mcp.viewer.fit_parts import Curve
from evidence_store import EvidenceStore, Job, StoreError

LEFT = re.compile(r", about ([\d.]+) (s|min|h|days) left$")
SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "days": 86_400.0}


def running_views(store: EvidenceStore, case: str) -> list[Running]:
    """Return the living work of a case, oldest first."""
    found = []
    for job in store.jobs.all():
        try:
            record = store.evidence.get(job.evidence)
        except StoreError:  # it ended between the two looks, or is damaged: the evidence says so
            continue
        if record.case == case and record.status == "running" and job.alive():
            found.append(_running(job, record.tool, record.summary))
    return found


def _running(job: Job, tool: str, summary: str) -> Running:
    left = LEFT.search(job.message)
    return Running(
        evidence=job.evidence,
        tool=tool,
        message=(job.message[: left.start()] if left else job.message) or summary,
        done=job.done,
        total=job.total,
        seconds_left=float(left[1]) * SECONDS[left[2]] if left else None,
        curve=Curve.model_validate(job.curve) if job.curve and job.curve["steps"] else None,
    )

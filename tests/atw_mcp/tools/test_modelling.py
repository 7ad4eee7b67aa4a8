"""What ModelVideo keeps of earlier calls, and how a fact is taken back."""

from __future__ import annotations

from pathlib import Path

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork
from atw_mcp.demo.truth import FOLDER
from atw_mcp.tools import modelling, opening
from atw_mcp.tools.measurement import LengthArgument
from evidence_store import Evidence


def test_motion_plane_is_kept_until_none_drops_it(tmp_path: Path) -> None:
    app = App(tmp_path / "atw.db")
    opening.open_case(app, video=str(FOLDER / "collision.mp4"), name="clip")
    length = LengthArgument(first_pixel=(10.0, 10.0), second_pixel=(110.0, 10.0), length=1.0)

    def plane_taken() -> bool:
        asked = modelling.model_video_tool(app, case="clip", known_length=length)
        assert isinstance(asked, LongWork)
        return '"plane":null' not in asked.key.replace(" ", "")

    assert not plane_taken()
    tilted = {"point": [0.0, 0.0, 0.0], "normal": [0.0, -1.0, 0.0]}
    app.store.evidence.add(Evidence("ModelVideo", {"motion_plane": tilted}, case="clip"))
    assert plane_taken()
    app.store.evidence.add(Evidence("ModelVideo", {"motion_plane": "none"}, case="clip"))
    assert not plane_taken()
    app.store.close()

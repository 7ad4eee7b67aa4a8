"""Worlds from files: BuildWorld takes MJCF, URDF, USD and JSON from allowed folders; the commands convert them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from atw_mcp.cli import main
from polyworld.world import World
from tests.atw_mcp.session import Session

pytest.importorskip("mujoco")
WEDGE = "v 0 0 0\nv .2 0 0\nv 0 .2 0\nv 0 0 .3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
ARM = """<mujoco><asset><mesh file="{mesh}"/></asset><worldbody><geom name="floor" type="plane" size="0 0 1"/>
  <body name="arm" pos="0 0 1"><joint name="pivot" axis="0 1 0" armature="0.1"/><geom type="mesh" mesh="wedge"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session(tmp_path / "store.db")


def test_an_mjcf_file_with_its_mesh_becomes_a_world_that_swings(session: Session, tmp_path: Path) -> None:
    (tmp_path / "wedge.obj").write_text(WEDGE)
    (tmp_path / "arm.xml").write_text(ARM.format(mesh="wedge.obj"))
    case = session("OpenCase", name="arm")["case"]
    built = session("BuildWorld", case=case, world=str(tmp_path / "arm.xml"))["data"]
    assert built["objects"][0]["shape"]["kind"] == "convex_mesh"
    assert any("armature 0.1 is left out" in sentence for sentence in built["assumed"])
    session("CommitWorld", case=case, world=built["world"])
    run = session("Rollout", case=case, horizon_seconds=0.3)["source"]["rollout"]
    path = session("ReadTrajectory", rollout=run, object="arm", fields=["z"])["data"]
    heights = [row[path["columns"].index("z")] for row in path["rows"]]
    assert heights[0] - heights[-1] > 0.005


def test_files_outside_the_allowed_folders_are_not_reached(session: Session, tmp_path: Path) -> None:
    case = session("OpenCase", name="arm")["case"]
    (tmp_path / "arm.xml").write_text(ARM.format(mesh="/usr/wedge.obj"))
    assert "not in a folder whose files may be read" in session.refused("BuildWorld", case=case, world="/usr/arm.xml")
    own = str(tmp_path / "arm.xml")
    assert "not in a folder whose files may be read" in _failed(session, case, own)
    for element in ('<include file="/etc/passwd"/>', '<asset><model name="a" file="/usr/a.xml"/></asset>'):
        (tmp_path / "arm.xml").write_text(f"<mujoco>{element}</mujoco>")
        assert "names other files in" in _failed(session, case, own)
    pytest.importorskip("pxr")
    stage = tmp_path / "stage.usda"
    stage.write_text('#usda 1.0\ndef "robot" (references = @/usr/robot.usda@) {}\n')
    assert "refers to other files" in _failed(session, case, str(stage))


def test_a_file_of_a_thousand_million_bodies_is_refused(session: Session, tmp_path: Path) -> None:
    case = session("OpenCase", name="many")["case"]
    grid = '<replicate count="1000" offset="1 0 0">'
    (tmp_path / "many.xml").write_text(
        f'<mujoco><worldbody>{grid * 3}<geom size="0.1"/>{"</replicate>" * 3}</worldbody></mujoco>'
    )
    assert "makes more than 20,000 elements" in _failed(session, case, str(tmp_path / "many.xml"))


def _failed(session: Session, case: str, path: str) -> str:
    """Return why a file is not read: that is long work, of which there is evidence."""
    with pytest.raises(AssertionError) as failed:
        session("BuildWorld", case=case, world=path)
    return str(failed.value)


def test_the_commands_convert_both_ways(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "wedge.obj").write_text(WEDGE)
    (tmp_path / "arm.xml").write_text(ARM.format(mesh="wedge.obj"))
    assert main(["import-world", str(tmp_path / "arm.xml")]) == 0
    shown = capfd.readouterr()
    assert "armature 0.1 is left out" in shown.err
    world = World.model_validate_json(shown.out)
    (tmp_path / "world.json").write_text(shown.out)
    assert main(["export-world", str(tmp_path / "world.json")]) == 0
    (tmp_path / "again.xml").write_text(capfd.readouterr().out)
    assert main(["import-world", str(tmp_path / "again.xml"), "--keyframe", "start"]) == 0
    again = World.model_validate_json(capfd.readouterr().out)
    assert again.objects[0].mass == pytest.approx(world.objects[0].mass)
    np.testing.assert_allclose(again.objects[0].position, world.objects[0].position, atol=1e-7)
    assert main(["import-world", str(tmp_path / "nothing.sdf")]) == 1
    assert "endings are" in capfd.readouterr().err

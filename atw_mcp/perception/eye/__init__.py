"""Follow bodies through frames by one likelihood of pixels: `observe(frames, bodies, seeds)` gives tracks and scene."""

from atw_mcp.perception.eye.bodies import Outline, Solid
from atw_mcp.perception.eye.discover import Proposal, discover
from atw_mcp.perception.eye.likelihood import background_scene
from atw_mcp.perception.eye.masks import BodyMask, body_mask
from atw_mcp.perception.eye.observe import Track, observe
from atw_mcp.perception.eye.seeds import Seed, outline_body
from atw_mcp.perception.eye.settings import EyeSettings

__all__ = [
    "BodyMask",
    "EyeSettings",
    "Outline",
    "Proposal",
    "Seed",
    "Solid",
    "Track",
    "background_scene",
    "body_mask",
    "discover",
    "observe",
    "outline_body",
]

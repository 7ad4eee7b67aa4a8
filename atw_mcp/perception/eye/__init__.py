"""The eye: states of bodies from pixels by one likelihood, from any hint at where they are.

    bodies = [Solid(...), outline_body("cart", seed)]
    tracks, scene = observe(frames, bodies, seeds)
"""

from atw_mcp.perception.eye.bodies import Outline, Solid
from atw_mcp.perception.eye.masks import BodyMask, body_mask
from atw_mcp.perception.eye.observe import Track, observe
from atw_mcp.perception.eye.seeds import Seed, outline_body
from atw_mcp.perception.eye.settings import EyeSettings

__all__ = ["BodyMask", "EyeSettings", "Outline", "Seed", "Solid", "Track", "body_mask", "observe", "outline_body"]

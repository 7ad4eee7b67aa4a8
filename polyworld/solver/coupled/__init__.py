"""The coupled solver: rigid bodies, ropes, cloth, soft bodies and fluids in one scene."""

"""Incompressible free-surface liquids: particles that carry them, a staggered grid that keeps them incompressible."""

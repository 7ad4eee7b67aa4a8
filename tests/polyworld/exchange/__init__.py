"""Worlds from and to other formats."""

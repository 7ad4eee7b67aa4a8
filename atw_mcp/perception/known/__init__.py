"""Observation of a video whose moving bodies are known: colour, apparent size and, perhaps, where they are seen."""

"""Random worlds and random files of other formats: none may crash the engine or its readers."""

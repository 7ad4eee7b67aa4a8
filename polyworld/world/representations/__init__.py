"""The physical models of objects: what each is described by."""

"""True tracks of rigid bodies, in clips and after them, from simulators that are not this project's."""

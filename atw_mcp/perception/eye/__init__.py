"""The eye: states of bodies from pixels by one likelihood, from any hint at where they are."""

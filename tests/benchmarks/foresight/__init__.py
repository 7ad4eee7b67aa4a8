"""How well worlds predict rendered clips, beside a straight line and beside staying: see `__main__`."""

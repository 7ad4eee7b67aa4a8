"""Balls and discs with one hidden effect, by integrators and laws that share nothing with the engine.

`cases` draws what is hidden, `design` the launches, `laws` and `outside` the effects inside and outside the catalogue,
`strength` how much of each, `observer` what is recorded, `disc_cases` colliding discs; `gaps hidden` judges verdicts.
"""

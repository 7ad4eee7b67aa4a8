"""Scenes with questions and answers that MuJoCo gives, laid out like CLEVRER's and ContPhy's downloads.

Nothing of the project is imported here: what is asked and what is right come from MuJoCo alone.
"""

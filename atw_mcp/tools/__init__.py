"""The tools, thin: each validates its arguments, calls the domain, records evidence and shapes the answer.

Read `construction` and `experimentation` first.
"""

"""Many cases in one go: a manifest in, one store with all their evidence and a file of answers out.

`manifest` says what a case is and refuses what no tool takes; `case` models and asks one, by the very tools, into a
store of its own (`shards`); `run` has an executor do that for all cases and puts the results together.
"""

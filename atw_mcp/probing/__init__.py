"""What agents read off rollouts: timelines, series, and answers of ensembles.

Read `readouts` first, then `ensembles`, `ensemble_answers` and `prediction_errors`.
"""

"""A small clip that an independent simulator made, its ground truth, and a script that answers a question about it."""

"""What is published beside the wheel, made by one command: `python -m tests.packaging OUT`."""

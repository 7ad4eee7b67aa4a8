"""What every solver shares: a world as arrays, the times of its steps, and the laws of effects and contacts."""

"""Parts of the gap workflow that `polyworld.gap` puts together: fits, scores, noise, the catalogue of effects."""

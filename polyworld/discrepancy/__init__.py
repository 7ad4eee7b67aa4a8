"""Where simulated and measured motion disagree, which effect is missing, and what adding it is worth."""

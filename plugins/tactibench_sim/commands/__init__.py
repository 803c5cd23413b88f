"""The command `tactibench sim`: what it draws, compares and fits."""

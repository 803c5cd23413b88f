"""Models that every other must beat: the training mean and the nearest training frame."""

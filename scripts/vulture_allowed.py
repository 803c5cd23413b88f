# Names that vulture takes for unused, because they are called by others.

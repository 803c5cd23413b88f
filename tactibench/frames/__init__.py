"""Where the frames of a run come from, and where they are kept."""

"""U-Net that reads contacts from heatmaps (TactiVerse)."""

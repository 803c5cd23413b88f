"""Hard cases: what is pressed, and what goes wrong between the skin and the model's input."""

"""Tables, published numbers and the board."""

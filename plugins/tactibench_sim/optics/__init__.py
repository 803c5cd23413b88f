"""The camera inside a sensor: from the places of its markers to frames."""

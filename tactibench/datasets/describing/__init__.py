"""What a recording holds: labels, pins, a sheet of frames."""

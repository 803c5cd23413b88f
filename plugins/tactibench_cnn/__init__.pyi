"""Public names of tactibench_cnn, and the modules that define them."""

from .model import CNN as CNN

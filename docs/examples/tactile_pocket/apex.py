"""A model: frames -> contacts."""

import json

from tactibench import Contacts, FitReport, Model, UserError


class Apex(Model):
    def __init__(self, context, depth=3.0):
        self.depth = depth

    def fit(self, frames, truth, *, validation, rng, progress):
        return FitReport(epochs=0)

    def predict(self, frames):
        return [Contacts([[0.0, 0.0]], [self.depth], [1.0]) for _ in frames]

    def save(self, directory):
        (directory / "apex.json").write_text(json.dumps({"depth": self.depth}))

    def load(self, directory):
        try:
            self.depth = json.loads((directory / "apex.json").read_text())["depth"]
        except (OSError, ValueError, KeyError) as error:
            raise UserError(f"{directory} holds no weights ({error}); train again.") from None

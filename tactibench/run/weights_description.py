"""``weights.json`` of a weights file, which describes the weights, and its model card."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

MOST_FILES = 64

Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ComponentValues(_Strict):
    """A model or an encoder with the values of all its parameters."""

    name: str
    parameters: dict[str, bool | int | float | str] = {}


class BuildContext(_Strict):
    """The context in which a model is made (`ModelContext`)."""

    answer: Literal["contacts", "plate"]
    cells: tuple[Annotated[int, Field(ge=1, le=1024)], Annotated[int, Field(ge=1, le=1024)]]
    origin_mm: tuple[float, float]
    pitch_mm: Annotated[float, Field(gt=0)]
    max_depth_mm: Annotated[float, Field(gt=0)]
    transfers: bool


class _EncoderIdentity(BaseModel):
    name: str
    code: str


class TrainedIdentity(BaseModel):
    """The part of an identity that is read; an identity has more entries."""

    model: str
    parameters: dict[str, bool | int | float | str]
    code: str
    encoder: _EncoderIdentity | None
    versions: dict[str, str]
    seed: int
    device: str


class _Report(BaseModel):
    """The part of a training's report that is read."""

    epochs: int
    seconds: float
    notes: dict[str, Any]


class WeightsDescription(_Strict):
    """The content of ``weights.json``.

    Attributes:
        made_with: Version of tactibench.
        model: The model, with its parameters.
        encoder: The encoder, with its parameters; None where the model uses none.
        context: The context in which the model is built.
        identity: Everything that determined the weights, as in the cache.
        files: sha256 of every file that the model saved, by name.
        hash: Hash of the weights, as records hold it.
        report: Report of the training.
        presses: Number of presses that the model learned from; None where it is not known.
        trained_on: Sensor and regime in words.
        license: License, as the exporter states it.
    """

    @model_validator(mode="after")
    def _is_of_this_model(self) -> Self:
        trained = TrainedIdentity.model_validate(self.identity)
        _Report.model_validate(self.report)
        if (trained.model, trained.parameters) != (self.model.name, self.model.parameters):
            raise ValueError("the weights were trained for another model than the file names")
        if (trained.encoder and trained.encoder.name) != (self.encoder and self.encoder.name):
            raise ValueError("the weights were trained for another encoder than the file names")
        return self

    schema_: Literal["tactibench-weights/1"] = Field(alias="schema")
    made_with: str
    model: ComponentValues
    encoder: ComponentValues | None
    context: BuildContext
    identity: dict[str, Any]
    files: Annotated[dict[str, Sha256], Field(min_length=1, max_length=MOST_FILES)]
    hash: Sha256
    report: dict[str, Any]
    presses: int | None
    trained_on: str
    license: str


def weights_card(description: WeightsDescription, label: str) -> str:
    """Return the model card in Markdown: the model, its training and its use.

    Args:
        description: Description of the weights.
        label: Title of the card.
    """
    identity = TrainedIdentity.model_validate(description.identity)
    report = _Report.model_validate(description.report)
    context = description.context
    settings = ", ".join(f"{k}={v}" for k, v in sorted(description.model.parameters.items()))
    half = context.pitch_mm * context.cells[1] / 2
    encoder = description.encoder.name if description.encoder else "none"
    versions = ", ".join(f"{k} {v}" for k, v in identity.versions.items())
    presses = "n/a" if description.presses is None else f"{description.presses:,}"
    rows = {
        "model": f"{description.model.name} ({settings or 'no parameters'})",
        "encoder": encoder,
        "answers": description.context.answer,
        "trained on": f"{description.trained_on}; {presses} presses, seed {identity.seed}",
        "training": f"{report.epochs} epochs, {report.seconds:.0f} s on {identity.device}",
        "made with": f"tactibench {description.made_with}, {versions}",
        "range": f"x and y within {half:g} mm of the map, depth to {context.max_depth_mm:g} mm",
        "weights": description.hash,
        "license": description.license,
    }
    table = "\n".join(f"| {name} | {_cell(value)} |" for name, value in rows.items())
    return f"""# {_cell(label)}

Weights of a model that reads a soft optical tactile sensor.

| | |
|---|---|
{table}

## Use

```python
from pathlib import Path
from tactibench.lab import open_weights

model, label = open_weights(Path("FILE.zip"))
contacts = model.predict([frame])[0]  # frame: tactibench.Frame, with the sensor's rest image
```

`tactibench demo FILE.zip` shows it on a simulated sensor, `tactibench hw live FILE.zip` on a real
one. `tactibench weights import FILE.zip` lets runs take these weights.

## Limits

It holds for the sensor, tips and range of its training. Other sensors, tips and light are what
`tactibench run stability` and `--test sensor.instance=1` measure. The file holds no scores: a run
makes them.
"""


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")

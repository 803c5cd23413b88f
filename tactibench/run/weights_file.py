"""Trained weights as one file, to pass them on, to serve them and to import them into a cache.

The file is a zip without compression: ``weights.json`` (a description), ``README.md`` (a model card
for people) and the files that the model saved, each with its sha256. Equal weights give equal
bytes. Sizes are limited and hashes compared before a model reads a file.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError

from tactibench import __version__
from tactibench.contacts import Grid
from tactibench.errors import UserError
from tactibench.plugins import Model, ModelContext, PluginHost
from tactibench.protocols import first_mistake
from tactibench.records import (
    BoundSpec,
    atomic,
    file_hash,
    installed_versions,
    locked,
    parse_json,
    write_checked_json,
)
from tactibench.run.machine import choose_device
from tactibench.run.plan import RunPlan, no_weights
from tactibench.run.weights import (
    MANIFEST,
    TRAINED_WITH,
    WeightsPlan,
    intact_manifest,
    training_code,
    weights_hash,
)
from tactibench.run.weights_description import (
    MOST_FILES,
    ComponentValues,
    TrainedIdentity,
    WeightsDescription,
    weights_card,
)

SUFFIX = ".zip"
DESCRIPTION, CARD, FOLDER = "weights.json", "README.md", "weights/"
FIRST_DAY = (1980, 1, 1, 0, 0, 0)
"""Time stamp of every entry: equal weights give equal bytes."""
MOST_BYTES = 2 * 1024**3
"""Largest size of all files together; the largest model that ships has 40 MB."""
MOST_DESCRIPTION_BYTES = 1024**2
"""Largest size of ``weights.json`` and of the model card."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}(/[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}){0,3}")
"""Name of a file inside: a relative path that never leads upwards."""
_TOO_LARGE = f"the files have more than {MOST_BYTES / 1024**3:g} GiB"


@dataclass(frozen=True)
class WeightsFile:
    """A weights file that was read and compared with its hashes.

    Attributes:
        path: Path of the file.
        sha256: sha256 of the whole file.
        description: Description of the weights.
        card: The model card, Markdown.
    """

    path: Path
    sha256: str
    description: WeightsDescription
    card: str

    @property
    def label(self) -> str:
        """Return the model's name and the first digits of the weights' hash."""
        return f"{self.description.model.name} ({self.description.hash[:8]})"

    def differences(self, host: PluginHost) -> list[str]:
        """Return in words what differs from the training: with differences, runs would train anew.

        Args:
            host: The plugins.

        Raises:
            UserError: The model or encoder is not installed, or does not have its parameters.
        """
        trained, model = (
            TrainedIdentity.model_validate(self.description.identity),
            self._model(host),
        )
        installed = installed_versions(*TRAINED_WITH)
        words = [
            f"{name} {installed.get(name)} in place of {trained.versions.get(name)}"
            for name in TRAINED_WITH
            if installed.get(name) != trained.versions.get(name)
        ]
        if trained.code != training_code(model):
            words.append(f"other source of {model.name} or of the training")
        encoder = self._encoder(host)
        if encoder and trained.encoder and trained.encoder.code != encoder.code():
            words.append(f"other source of encoder {encoder.name}")
        return words

    def build(self, host: PluginHost, device: str) -> Model:
        """Build the model, without its weights, and return it.

        Args:
            host: The plugins.
            device: "cpu" or "cuda".

        Raises:
            UserError: The model or encoder is not installed, or does not have its parameters.
        """
        description, encoder = self.description, self._encoder(host)
        context = description.context
        model: Model = self._model(host).build(
            ModelContext(
                answer=context.answer,
                grid=Grid(context.cells, context.origin_mm, context.pitch_mm),
                max_depth=context.max_depth_mm,
                encoder=encoder and encoder.build(),
                device=device,
                transfers=context.transfers,
            )
        )
        return model

    def write_files(self, folder: Path) -> None:
        """Write the model's files into an empty folder."""
        with _opened(self.path) as archive:
            for name in self.description.files:
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(FOLDER + name) as source, target.open("wb") as out:
                    shutil.copyfileobj(source, out)

    def _model(self, host: PluginHost) -> Any:
        return _bound(host.models, self.description.model)

    def _encoder(self, host: PluginHost) -> Any:
        given = self.description.encoder
        return given and _bound(host.encoders, given)


def export_weights(plan: RunPlan, path: Path, *, license_text: str = "not stated") -> WeightsFile:
    """Write the cached weights of a plan as one file, and return the file as it is read back.

    Args:
        plan: The plan of a run with these weights.
        path: The file that is written.
        license_text: License of the weights.

    Raises:
        UserError: The weights are not in the cache, are damaged, or are too many or too large for a
            file that can be read back.
    """
    manifest = intact_manifest(plan.weights)
    label = plan.components.model.label
    if manifest is None:
        raise no_weights(plan)
    if why := _unusable_names(manifest["files"]):
        raise _not_one_file(label, why)
    context, encoder = plan.context(), plan.components.encoder
    sensor = plan.components.sensor.label
    description = {
        "schema": "tactibench-weights/1",
        "made_with": __version__,
        "model": _values(plan.components.model),
        "encoder": None if encoder is None else _values(encoder),
        "context": {
            "answer": context.answer,
            "cells": context.grid.shape,
            "origin_mm": context.grid.origin,
            "pitch_mm": context.grid.pitch,
            "max_depth_mm": context.max_depth,
            "transfers": context.transfers,
        },
        "identity": plan.weights.identity,
        "files": manifest["files"],
        "hash": manifest["hash"],
        "report": manifest["report"],
        "presses": manifest.get("presses"),
        "trained_on": f"{sensor}, regime {plan.components.regime} of {plan.spec.id}",
        "license": license_text,
    }
    checked = WeightsDescription.model_validate_json(_json(description))
    texts = {DESCRIPTION: _json(description), CARD: weights_card(checked, label)}
    paths = {FOLDER + name: plan.weights.folder / name for name in sorted(checked.files)}
    lengths = [len(text.encode()) for text in texts.values()]
    if max(lengths) > MOST_DESCRIPTION_BYTES:
        raise _not_one_file(label, "the notes of the training are too long")
    if sum([*lengths, *(file.stat().st_size for file in paths.values())]) > MOST_BYTES:
        raise _not_one_file(label, _TOO_LARGE)
    with atomic(path) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, text in texts.items():
            archive.writestr(zipfile.ZipInfo(name, FIRST_DAY), text)
        for name, file in paths.items():
            archive.writestr(zipfile.ZipInfo(name, FIRST_DAY), file.read_bytes())
    return read_weights(path)


def read_weights(path: Path, *, sha256: str | None = None) -> WeightsFile:
    """Read a weights file and compare every hash.

    Args:
        path: The file.
        sha256: sha256 of the whole file, as its sender stated it; None to compare none.

    Raises:
        UserError: The file does not exist, is no weights file, is damaged, or has another sha256.
    """
    if not path.is_file():
        raise UserError(f"{path} is not there; name a file of `tactibench weights export`.")
    actual = file_hash(path)
    if sha256 is not None and sha256.lower() != actual:
        raise UserError(
            f"{path} has the sha256 {actual}, not {sha256[:80]}; it is another file or was changed "
            "on its way: get it again."
        )
    with _opened(path) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
        _check_sizes(path, archive.infolist())
        try:
            description = WeightsDescription.model_validate(
                parse_json(_text(archive, entries, DESCRIPTION))
            )
        except ValidationError as error:
            raise _damaged(path, first_mistake(error, WeightsDescription).rstrip(".")) from None
        except (KeyError, ValueError, RecursionError) as error:
            raise _damaged(path, f"{DESCRIPTION} cannot be read ({error})") from None
        files = description.files
        if why := _unusable_names(files):
            raise _damaged(path, why)
        expected = {DESCRIPTION, CARD, *(FOLDER + name for name in files)}
        if set(entries) != expected:
            raise _damaged(path, "it holds other files than it lists")
        if description.hash != weights_hash(files):
            raise _damaged(path, "the hash of its weights is not that of its files")
        for name, value in files.items():
            try:
                same = _entry_hash(archive, FOLDER + name) == value
            except (zipfile.BadZipFile, OSError, ValueError, EOFError):
                same = False
            if not same:
                raise _damaged(path, f"the sha256 of {name} does not fit")
        try:
            card = _text(archive, entries, CARD)
        except ValueError as error:
            raise _damaged(path, f"{CARD} cannot be read ({error})") from None
    return WeightsFile(path, actual, description, card)


def open_weights(
    path: Path, *, sha256: str | None = None, device: str = "auto"
) -> tuple[Model, str]:
    """Return the model of a weights file, ready to answer frames, and its label.

    Args:
        path: A file of ``tactibench weights export``.
        sha256: sha256 of the whole file; None to compare none.
        device: "auto", "cpu" or "cuda".

    Raises:
        UserError: The file is damaged, has another sha256, or this installation has no such model.
    """
    file = read_weights(path, sha256=sha256)
    model = file.build(PluginHost(), choose_device(device))
    with TemporaryDirectory(prefix="tactibench-weights-") as folder:
        file.write_files(Path(folder))
        model.load(Path(folder))
    return model, file.label


def import_weights(file: WeightsFile, cache: Path) -> tuple[Path, bool]:
    """Put weights into the cache, where runs find them; records of these runs state the import.

    Args:
        file: The weights file.
        cache: Folder of the cache.

    Returns:
        The folder of the weights, and whether they were in the cache before.

    Raises:
        UserError: This installation would train other weights for the same request, so that no run
            would use these; or it has no such model.
    """
    host = PluginHost()
    if different := file.differences(host):
        raise UserError(
            f"{file.path} does not match this installation ({', '.join(different)}), so no run "
            "would take its weights; serve the file itself, as `tactibench demo` and "
            "tactibench.lab.open_weights do, or install what it was made with."
        )
    description = file.description
    plan = WeightsPlan.of(description.identity, cache)
    with locked(plan.folder.with_name(plan.folder.name + ".lock")):
        if intact_manifest(plan) is not None:
            return plan.folder, True
        temporary = plan.folder.with_name(plan.folder.name + ".made")
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        file.write_files(temporary)
        file.build(host, "cpu").load(temporary)  # refuses weights of another architecture
        notes = {**description.report["notes"], "imported": file.sha256}
        manifest = {
            "identity": description.identity,
            "files": description.files,
            "hash": description.hash,
            "report": {**description.report, "notes": notes},
            "presses": description.presses,
        }
        write_checked_json(temporary / MANIFEST, manifest)
        shutil.rmtree(plan.folder, ignore_errors=True)  # damaged
        temporary.rename(plan.folder)
    return plan.folder, False


def _values(component: BoundSpec[Any]) -> dict[str, Any]:
    return {"name": component.name, "parameters": dict(component.values)}


def _bound(catalogue: Any, component: ComponentValues) -> Any:
    given = {name: str(value) for name, value in component.parameters.items()}
    return BoundSpec.named(catalogue, component.name, given)


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, indent=1, sort_keys=True, allow_nan=False)


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise _damaged(path, f"it is no zip ({error})") from None


def _check_sizes(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MOST_FILES + 2 or len({e.filename for e in entries}) < len(entries):
        raise _damaged(path, "it holds too many files, or two of one name")
    if any(e.compress_type != zipfile.ZIP_STORED or e.flag_bits & 1 for e in entries):
        raise _damaged(path, "its files are compressed or encrypted, which export never does")
    if sum(e.file_size for e in entries) > MOST_BYTES:
        raise _damaged(path, _TOO_LARGE)


def _unusable_names(files: Mapping[str, str]) -> str:
    """Return why files of these names cannot be in a weights file; "" where they can."""
    if not 1 <= len(files) <= MOST_FILES:
        return f"there are {len(files)} files, and 1 to {MOST_FILES} are allowed"
    bad = [name for name in files if not _NAME.fullmatch(name) or ".." in name]
    if not bad:
        return ""
    return f"the file name {bad[0][:80]!r} has more than letters, digits, '_', '-' and single dots"


def _text(archive: zipfile.ZipFile, entries: Mapping[str, zipfile.ZipInfo], name: str) -> str:
    """Return the text of an entry.

    Raises:
        ValueError: The entry is missing, too long or no text.
    """
    if name not in entries or entries[name].file_size > MOST_DESCRIPTION_BYTES:
        raise ValueError("it is missing or too long")
    try:
        return archive.read(name).decode()
    except (zipfile.BadZipFile, OSError, EOFError) as error:
        raise ValueError(str(error)) from None


def _entry_hash(archive: zipfile.ZipFile, name: str) -> str:
    total = hashlib.sha256()
    with archive.open(name) as stream:
        while part := stream.read(1024**2):
            total.update(part)
    return total.hexdigest()


def _not_one_file(label: str, why: str) -> UserError:
    return UserError(
        f"the weights of {label} cannot be exported: {why}; change what the model saves and train "
        "it again."
    )


def _damaged(path: Path, why: str) -> UserError:
    return UserError(f"{path} holds no usable weights: {why}; get it again or export it again.")

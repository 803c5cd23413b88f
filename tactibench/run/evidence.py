"""Hashes of all that a small run makes, and the process in which ``repeated`` has it made."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from tactibench.errors import UserError

Evidence = dict[str, str]
"""What was made -> sha256 of it."""


@dataclass(frozen=True)
class Asked:
    """What is repeated, with the seed 0: a ``--quick`` run that is neither timed nor drawn.

    sensor None: the protocol's default."""

    model: str
    protocol: str = "exp1"
    sensor: str | None = None


def evidence(asked: Asked, cache: Path, *, frames_only: bool = False) -> Evidence:
    """Do the work in this process and give the hashes of what came out.

    Weights are those of the files that are kept, answers those at batch 1, metrics all rows with
    their intervals. Raises UserError.
    """
    from tactibench.plugins.host import PluginHost
    from tactibench.records.answers import pack
    from tactibench.records.files import arrays_hash
    from tactibench.records.identity import combined, digest
    from tactibench.run.plan import make_plan
    from tactibench.run.predict import predict_all
    from tactibench.run.reporter import Silent
    from tactibench.run.request import RunRequest
    from tactibench.run.score import score_arrays
    from tactibench.run.train import open_frames, trained_model
    from tactibench.run.truth import true_answers, truth_arrays

    request = RunRequest(**asdict(asked), quick=True, device="cpu")
    plan = make_plan(request, PluginHost(), cache)
    keys, reporter = plan.protocol.keys, Silent()
    if keys.families or keys.transfer is not None:
        raise UserError(
            f"protocol {keys.id!r} changes sensors while it tests; repeat one that presses one "
            "sensor, such as exp1."
        )
    opened = [(wanted, open_frames(wanted, reporter)) for wanted in plan.frames]
    found = {
        f"frames, {role}": combined([p.hash for wanted, p in opened if wanted.role == role])
        for role in ("fit", "validation", "test")
    }
    if frames_only:
        return found
    model, trained = trained_model(plan, reporter)
    test = [(wanted, presses) for wanted, presses in opened if wanted.role == "test"]
    frames = [frame for _, presses in test for frame in presses.frames]
    most, shape = plan.parts.model.spec.max_contacts, keys.grid.grid().shape
    answers, heat = predict_all(model, frames, keys.answer, most, shape, lambda _: None)
    predicted = pack(answers, keys.answer)
    maps = {} if heat is None else {"maps": heat}
    truth = truth_arrays(
        keys,
        true_answers(keys, [presses for _, presses in test]),
        [name for wanted, presses in test for name in wanted.presses or presses.names],
        [group for wanted, _ in test for group in wanted.groups],
    )
    return {
        **found,
        "weights": trained.hash,
        "answers": arrays_hash({**predicted, **maps}),
        "metrics": digest(
            [row.json_values() for row in score_arrays(keys, truth, predicted, maps)]
        ),
    }


def main() -> None:
    """One time, in a process of its own: what is asked as JSON in, hashes as JSON out."""
    from tactibench.records.cache import cache_folder

    given = json.loads(sys.argv[1])
    only = given.pop("frames_only")
    try:
        found = evidence(Asked(**given), cache_folder(), frames_only=only)
    except UserError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()

"""Records with one untruth in them; see ``forged``."""

from __future__ import annotations

from typing import Any

from forged import SHA_OF_NOTHING, Change, Forgery, Values, both, drop, put

SHA = "ab" * 32


def _set_sensor(**values: Any) -> Change:
    """Another sensor, said as whoever runs on it would say it."""

    def change(record: Values) -> None:
        record["sensor"]["parameters"] |= values
        record["sensor"]["settings"] = list(values)

    return change


def _heatmap_error(record: Values) -> None:
    """An error of heatmaps, which the run did not store."""
    record["identity"]["stored"]["maps"] = SHA_OF_NOTHING
    for row in record["metrics"]:
        if row["metric"] == "surface_rmse_mm":
            row |= {"value": 0.001, "low": 0.001, "high": 0.001, "n": 9, "clusters": 9}


def _negative_heatmap_error(record: Values) -> None:
    record["identity"]["stored"]["maps"] = SHA
    for row in record["metrics"]:
        if row["metric"] == "surface_rmse_mm":
            row |= {"value": -1.0, "low": -1.0, "high": -1.0, "n": 9, "clusters": 9}


OTHER_SENSOR = {
    "name": "tactip-127",
    "parameters": {},
    "asked": [],
    "on": "the nominal sensor",
    "presses": 1320,
}


def _other_machine(values: Values) -> None:
    values["environment"]["fingerprint"] = values["identity"]["machine"] = "0123456789ab"


def _renamed(values: Values) -> None:
    values["name"] = values["name"].replace("-mean-", "-unet-")


def _oracle(values: Values) -> None:
    """A trivial model under another name: it is ranked, where `mean` stands last."""
    values["model"]["name"] = "oracle"
    values["name"] = values["name"].replace("-mean-", "-oracle-")


def _doubled_speed(values: Values) -> None:
    values["speed"].append(dict(values["speed"][0]))


VALUES: dict[str, tuple[tuple[str, Any], ...]] = {
    "instance": (
        # What was tested.
        ("sensor.tested.name", "tactip-331"),
        ("sensor.tested.parameters.noise", False),
        ("sensor.tested.parameters", {}),
        ("sensor.tested.on", "a real TacTip, glued by hand"),
        ("sensor.tested.asked", ["data=/etc"]),
        ("sensor.tested.asked", ["sensor.instance=1", "sensor.table=../../../etc/hostname"]),
        ("sensor.tested.asked", ["sensor.instance=1", "shots=0"]),
        ("sensor.tested.presses", 1_000_000),
        ("sensor.tested.trained_on", "a real recording"),
        ("sensor.tested.settings", ["size"]),
        # What was trained on.
        ("sensor.tested.parameters.blur", 1e-12),
    ),
    "reference": (
        # What was tested.
        ("sensor.tested.name", "tactip-127"),
        ("sensor.tested.on", "real scenes"),
        ("sensor.tested.asked", ["reference"] * 2),
    ),
    "plain": (
        # What was tested.
        ("sensor.tested", OTHER_SENSOR),
        # What was trained on.
        ("sensor.origin", "real"),
        ("sensor.parameters.noise", False),
        ("sensor.settings", ["size", "noise"]),
        ("sensor.parameters", {}),
        ("sensor.parameters.table", "evil.npz"),
        ("sensor.parameters.size", 1024),
        ("sensor.parameters.instance", False),
        ("sensor.parameters.full_well", 1e308),
        ("sensor.parameters.tolerance", "perfect"),
        ("sensor.parameters.blur", 0),
        ("sensor.parameters.blur", -0.0),
        ("sensor.account", {"test": {"measured": 1320}}),
        ("sensor.parameters.instance", 7),
        ("sensor.recording", {"label": "mine", "sha256": SHA, "sensor": "TacTip"}),
        (
            "sensor.range",
            {
                "half_width_mm": 1.0,
                "depth_min_mm": 1.0,
                "depth_max_mm": 2.0,
                "dome_radius_mm": None,
            },
        ),
        ("sensor", {"name": "tactip", "origin": "real", "parameters": {"config": "hw.toml"}}),
        ("regime", "zebra"),
        ("regime", "multiple"),
        # What cut it short.
        ("limits.limit", 10),
        ("limits.quick", True),
        ("limits.presses", 100),
        ("limits.presses", -5),
        ("limits.verified", True),
        # What it was made of.
        ("identity.limit", 10),
        ("identity.quick", True),
        ("identity.presses", 100),
        ("identity.seed", 5),
        ("identity.protocol", "exp9@1"),
        ("identity.hidden", SHA),
        ("identity.tested", SHA),
        ("identity.shots", SHA),
        ("identity.released", [{"table": "mine"}]),
        ("identity.data", None),
        ("identity.data", [SHA]),
        ("identity.data", ["real", "frames"]),
        ("identity.test_frames", []),
        ("identity.plugins", {}),
        ("identity.plugins.sim.distribution", "my-sim"),
        ("identity.machine", "0123456789ab"),
        ("identity.reviewed", "yes"),
        ("identity.stored.audit", SHA),
        ("identity.commit", "reviewed"),
        ("identity.code", "mine"),
        ("identity.weights_hash", "best"),
        ("identity.sealed", SHA),
        # Where it ran and how long it took.
        ("environment.cpu", "Cray"),
        ("environment.threads", 0),
        ("environment.audited", True),
        ("speed.0.mean_ms", -1.0),
        ("speed.0.scenario", "magic"),
        ("speed.0.per_s", 1e300),
        ("speed.0.threads", -1),
        ("timed.certified", True),
        ("timed.p50_ms", -3.0),
        ("efficiency.parameters", -1),
        ("efficiency.training_s", 1e-6),
        ("training.seconds", -1.0),
        ("training.presses", 10),
        ("training.epochs", -3),
        ("training.human", True),
        ("training.notes", {"mixing": 3, "prior": "x"}),
        # What was counted.
        ("data.train", 10),
        ("data.validation", 0),
        ("data.rejected", 0),
        ("data.published_frames", True),
        (
            "data.simulator",
            [
                {
                    "name": "pairs",
                    "scenes": 1320,
                    "unknown": 0,
                    "median_mm": 0.0,
                    "p95_mm": 0.0,
                    "max_mm": 0.0,
                }
            ],
        ),
        ("data.of_tested_sensor", {"labelled_frames": [50, 50], "unlabelled_frames": 9}),
        ("data.failures", {"frames": 9, "causes": []}),
        ("data.leaked", 0),
        # What it is called.
        ("protocol.title", "two-point discrimination, hard"),
        ("created", "first of all"),
        ("created", "9999-01-01T00:00:00+00:00"),
        ("encoder", {"name": "hertz", "parameters": {}}),
        ("seed", "0"),
    ),
    "encoded": (
        # What it was made of.
        ("identity.encoder.parameters.blur", 9.0),
        # What it is called.
        ("model.parameters.oracle", True),
    ),
    "failing": (
        # What was counted.
        ("data.failures.frames", 99),
    ),
}
"""Base of a forgery -> keys and what they are made to say."""


CHANGES = (
    # What was tested.
    Forgery("tested.parameters lack one", "instance", drop("sensor.tested.parameters.blur")),
    Forgery("tested left out", "instance", both(drop("sensor.tested"), drop("identity.tested"))),
    # What was trained on.
    Forgery(
        "sensor without noise, unsaid",
        "plain",
        both(put("sensor.parameters.noise", False), put("sensor.settings", [])),
    ),
    Forgery("sensor.parameters lack one", "plain", drop("sensor.parameters.blur")),
    Forgery("sensor of 1000 instances", "plain", _set_sensor(version=1, instances=1000)),
    Forgery("sensor.parameters long", "plain", _set_sensor(glare_seed=10**9 + 1)),
    Forgery("heatmaps of no run", "encoded", _heatmap_error),
    Forgery("heatmaps below nothing", "encoded", _negative_heatmap_error),
    Forgery(
        "one contact in several",
        "plain",
        both(put("model.name", "cnn"), put("regime", "multiple")),
    ),
    # What cut it short.
    Forgery(
        "limits.presses left out",
        "few",
        both(put("limits.presses", None), put("identity.presses", None)),
    ),
    Forgery(
        "limits.presses others",
        "few",
        both(put("limits.presses", 100), put("identity.presses", 100)),
    ),
    # What it was made of.
    Forgery("identity.tested none", "instance", drop("identity.tested")),
    # Where it ran and how long it took.
    Forgery("environment.fingerprint", "plain", _other_machine),
    Forgery("speed twice", "plain", _doubled_speed),
    # What was counted.
    Forgery("data.failures left out", "failing", drop("data.failures")),
    # What it is called.
    Forgery("name", "plain", _renamed),
    Forgery("model.name", "plain", _oracle),
    Forgery(
        "model.settings",
        "encoded",
        both(put("model.parameters.epochs", 3), put("model.settings", [])),
    ),
    Forgery(
        "encoder left out", "encoded", both(put("encoder", None), put("identity.encoder", None))
    ),
    Forgery("seed", "plain", both(put("seed", 10**30), put("identity.seed", 10**30))),
    Forgery("seed negative", "plain", both(put("seed", -1), put("identity.seed", -1))),
)
"""Forgeries of more than one value, or of a key that is taken away."""


FORGERIES = (
    *(
        Forgery(f"{key} {value!r}"[:80], base, put(key, value))
        for base, several in VALUES.items()
        for key, value in several
    ),
    *CHANGES,
)

"""Records with one untruth in them; see ``forged``."""

from __future__ import annotations

from typing import Any

from forged import SHA_OF_NOTHING, Change, Forgery, Values, both, drop, put

from tactibench.run import fingerprint_hash

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


def _stranger(name: str, **parameters: Any) -> Change:
    """A model of somebody else, whose plugin is named as a run would name it."""

    def change(values: Values) -> None:
        settings = {"settings": list(parameters)} if parameters else {}
        values["model"] = {"name": name, "parameters": parameters, **settings}
        values["name"] = values["name"].replace("-mean-", f"-{name}-")
        plugins = values["identity"]["plugins"]
        del plugins["baselines"]
        plugins["theirs"] = {"distribution": "theirs", "version": "1", "code": SHA[:16]}

    return change


def _many_times(values: Values) -> None:
    """Latency of thousands of batches."""
    (first,) = [row for row in values["speed"] if row["phase"] == "total"][:1]
    values["speed"] += [
        {**first, "batch": batch, "per_s": 1e3 * batch / first["mean_ms"]}
        for batch in range(2000, 4000)
    ]


def _many_versions(values: Values) -> None:
    values["environment"]["versions"] |= {f"package-{k}": "1" for k in range(9000)}


def _on_machine(**facts: Any) -> Change:
    """Another machine, with the fingerprint that its facts give."""

    def change(values: Values) -> None:
        values["environment"] |= facts
        stated = {
            name: value
            for name, value in values["environment"].items()
            if name not in ("fingerprint", "threads", "versions")
        }
        values["environment"]["fingerprint"] = fingerprint_hash(stated)
        values["identity"]["machine"] = values["environment"]["fingerprint"]

    return change


def _version(text: str) -> Change:
    """Another version of tactibench, which the signature shows."""

    def change(values: Values) -> None:
        values["environment"]["versions"]["tactibench"] = text
        for plugin in values["identity"]["plugins"].values():
            plugin["version"] = text

    return change


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
        # What pages and terminals show.
        ("training.notes.prior", "Checked, by the authors"),
        ("training.notes.prior", "p" * 4000),
        ("training.device", "cpu " * 900),
        ("training.device", "<b>cpu</b>"),
        ("timed.configuration", "c" * 4000),
        ("timed.configuration", "e\u0301\u0301\u0301\u0301"),
        ("environment.versions.numpy", "2 " * 2000),
        ("identity.versions", {"numpy": "x" * 200}),
        ("training.notes.more", ["x" * 3000] * 300),
        # What it is called.
        ("protocol.title", "two-point discrimination, hard"),
        ("created", "first of all"),
        ("created", "9999-01-01T00:00:00+00:00"),
        ("created", "2099-12-31T00:00:00+00:00"),
        ("created", "2026-W47-1T00:00:00+00:00"),
        ("created", "2026-11-22T02:43:44+23:59"),
        ("created", "20261122T024344Z"),
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
    Forgery("another model by case", "plain", _stranger("Unet")),
    Forgery("another model by a sign", "plain", _stranger("u-net")),
    Forgery("another model by a digit", "plain", _stranger("superp0se")),
    Forgery("a trivial model by case", "plain", _stranger("MEAN")),
    Forgery(
        "a model that reads like two rows", "plain", _stranger("mine", of="1 + hertz (single)")
    ),
    Forgery("a model with a long word", "plain", _stranger("mine", of="x" * 4000)),
    Forgery("a model in another script", "plain", _stranger("mine", of="\u043dertz")),
    Forgery("a model with signs of its signature", "plain", _stranger("mine", of="1)|seed:7")),
    Forgery(
        "a model of many parameters",
        "plain",
        _stranger("mine", **{f"p{k}": k for k in range(300)}),
    ),
    Forgery("a model of a long parameter", "plain", _stranger("mine", **{"p" * 150: 1})),
    Forgery(
        "plugins like ours",
        "plain",
        both(_stranger("mine"), put("identity.plugins.theirs.distribution", "Tactibench")),
    ),
    Forgery(
        "plugins with a long distribution",
        "plain",
        both(_stranger("mine"), put("identity.plugins.theirs.distribution", "d" * 4000)),
    ),
    Forgery(
        "plugins with a version that is none",
        "plain",
        both(_stranger("mine"), put("identity.plugins.theirs.version", "1 | verified")),
    ),
    Forgery("version with signs of its signature", "plain", _version("0.1.0|verified:yes")),
    Forgery("cpu with marks on letters", "plain", _on_machine(cpu="A\u0336M\u0336D\u0336")),
    Forgery("cpu that is long", "plain", _on_machine(cpu="AMD " * 900)),
    Forgery("many gpus", "plain", _on_machine(gpu=["H100"] * 9000)),
    Forgery("many flags", "plain", _on_machine(cpu_flags=["avx2"] * 9000)),
    Forgery("many versions", "plain", _many_versions),
    Forgery("many times", "plain", _many_times),
    Forgery("many configurations", "plain", put("timed.raced", [{"configuration": "x"}] * 9000)),
    Forgery("memory below nothing", "plain", _on_machine(memory_gib=-4)),
    Forgery("cores below nothing", "plain", _on_machine(cores_physical=-4)),
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
